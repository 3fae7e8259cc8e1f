//! Error-state Kalman filter fed by IMU, pose fixes and morph angle.
