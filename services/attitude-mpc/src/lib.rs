//! Attitude MPC: attitude setpoint and state estimate in, wrench command out.
