//! Position MPC: reference and state estimate in, attitude setpoint out.
