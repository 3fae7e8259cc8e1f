//! What the vehicle's sensors make of the truth: noise, bias, range, rate, latency, drop-outs.
//!
//! Every sensor is a function of its configuration, its seed and the truths it was shown. Its whole
//! evolving state is a plain `…Memory`; a sensor that restores it continues bit for bit. A sensor
//! may be shown the truth at any instants: it samples at the first one at or after each release of
//! its own rate. [`Sensor`] is what they have in common, and `table.rs` lists them. The default numbers are typical of
//! the class of vehicle: a small MEMS inertial sensor, an optical tracker, a magnetic encoder.

mod barometer;
mod config;
mod imu;
mod morph_encoder;
mod pose_fix;
mod range_finder;
mod schedule;
mod sensor;
mod table;

pub use barometer::{Barometer, BarometerConfig, BarometerMemory};
pub(crate) use config::finite;
pub use config::{
    BiasStep, DELAY_LINE_LEN, DropOut, ImuConfig, MAX_SENSOR_RATE_HZ, MorphEncoderConfig,
    PoseFixConfig, SensorError,
};
pub use imu::{Imu, ImuMemory, ImuSample};
pub use morph_encoder::{MorphEncoder, MorphEncoderMemory};
pub use pose_fix::{Pose, PoseFix, PoseFixMemory, PoseSample};
pub use range_finder::{RangeFinder, RangeFinderConfig, RangeFinderMemory};
pub use sensor::Sensor;
pub(crate) use table::Sensors;
pub use table::{SensorConfigs, SensorsMemory};
