//! Error-state Kalman filter fed by IMU, pose fixes, morph angle and, where there are such sensors, heights.
//!
//! Reads inertial samples, delayed pose fixes and the encoder of the morph angle; writes position,
//! velocity, attitude, body rate, sensor biases and the morph angle with their uncertainty. World
//! frame W is ENU, body frame B is FLU, `q_wb` is a Hamilton quaternion that turns body vectors into
//! world. All units are SI, all instants integer nanoseconds. No clock, file or topic is read here.
//!
//! The filter is the error-state filter of J. Solà, *Quaternion kinematics for the error-state
//! Kalman filter* (arXiv:1711.02508, 2017), with the attitude error on the body side. Added to it:
//! fixes are applied at their capture and the inertial samples since are replayed; innovations are
//! gated and monitored: both can re-open the covariance, and more spread than promised is believed.
//!
//! Open `filter/mod.rs` next: it is the pipeline; then one file per measurement model.

pub mod component;
mod filter;
pub mod settings;

pub use component::Estimator;
pub use filter::{
    AlarmFlags, BarometerModel, BeliefMemory, ConfigError, Counters, Covariance, Estimate, Filter,
    FilterConfig, FilterMemory, ImuMemory, ImuSample, InitialState, MAX_NIS_WINDOW, MemoryError,
    MorphAngleSample, PoseFixSample, RangeFinderModel, ReopenSigmas, STATE_DIMENSION, Scalar,
    Verdict, VerdictCounts,
};
