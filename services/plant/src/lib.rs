//! The simulated vehicle with its sensors and its actuation gate.
