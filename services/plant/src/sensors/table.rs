//! The table of the vehicle's sensors: a new one is a file and a line here.

use super::barometer::Barometer;
use super::config::SensorError;
use super::imu::Imu;
use super::morph_encoder::MorphEncoder;
use super::pose_fix::PoseFix;
use super::range_finder::RangeFinder;
use super::sensor::Sensor;
use crate::ports::Outputs;
use shared_types::TopicInfo;
use vehicle::Truth;

/// Declares the sensors of the vehicle: `name: Sensor;`, one a line.
macro_rules! sensors {
    ($($(#[doc = $doc:literal])+ $name:ident: $sensor:ident;)+) => {
        /// What the sensors are built from.
        #[derive(Debug, Clone, Default)]
        pub struct SensorConfigs {
            $($(#[doc = $doc])+ pub $name: <$sensor as Sensor>::Config,)+
        }

        impl SensorConfigs {
            /// Readings per second on a topic \[Hz\], 0 if the vehicle has no such sensor; none if no sensor is
            /// published on it.
            #[must_use]
            pub fn rate_hz(&self, topic: &TopicInfo) -> Option<u32> {
                $(if topic.name == <$sensor as Sensor>::TOPIC.name {
                    return Some($sensor::rate_hz(&self.$name));
                })+
                None
            }
        }

        shared_types::memory! {
            /// What evolves in the sensors.
            pub struct SensorsMemory {
                $($(#[doc = $doc])+ pub $name: <$sensor as Sensor>::Memory),+
            }
        }

        /// What the sensors have seen at one instant.
        pub(crate) struct Seen {
            $($(#[doc = $doc])+ #[allow(dead_code, reason = "the plant itself looks at few of them")]
            pub(crate) $name: Option<<$sensor as Sensor>::Reading>,)+
        }

        /// All sensors of the vehicle.
        #[derive(Debug, Clone)]
        pub(crate) struct Sensors {
            $(pub(crate) $name: $sensor,)+
        }

        impl Sensors {
            pub(crate) fn new(configs: &SensorConfigs, seed: u64) -> Result<Self, SensorError> {
                Ok(Self { $($name: Sensor::new(&configs.$name, seed)?,)+ })
            }

            pub(crate) fn look(
                &mut self,
                now_ns: u64,
                truth: &Truth,
                outputs: &mut Outputs,
            ) -> Seen {
                Seen { $($name: self.$name.look(now_ns, truth, outputs),)+ }
            }

            pub(crate) fn memory(&self) -> SensorsMemory {
                SensorsMemory { $($name: self.$name.memory(),)+ }
            }

            pub(crate) fn restore(&mut self, memory: &SensorsMemory) {
                $(self.$name.restore(&memory.$name);)+
            }

            pub(crate) fn reseed(&mut self, seed: u64) {
                $(self.$name.reseed(seed);)+
            }
        }
    };
}

sensors! {
    /// Inertial sensor.
    imu: Imu;
    /// Pose tracker.
    pose_fix: PoseFix;
    /// Morph encoder.
    morph_encoder: MorphEncoder;
    /// Barometer.
    barometer: Barometer;
    /// Range finder.
    range_finder: RangeFinder;
}
