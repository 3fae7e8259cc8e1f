//! What every sample carries besides its payload: identity, logical time, host stamps and cause.

use crate::sample;
use crate::wire::Shared;

sample! {
    /// Identity, time and cause of a sample.
    ///
    /// Host stamps never influence a step; they exist so that a recording alone gives age, wait,
    /// compute time and latency of every sample, measured from the intended release.
    #[derive(PartialEq)]
    pub struct Header {
        /// Counts up by one per topic and producer seat, from 1.
        pub sequence: u64,
        /// Logical instant of the producing step \[ns\].
        pub release_ns: u64,
        /// Logical instant from which the sample is in effect \[ns\].
        pub valid_ns: u64,
        /// Sequence of the IMU sample this one descends from; 0 if none.
        pub cause_sequence: u64,
        /// Sequence of the sample of its first input that the producing step went by; 0 if none.
        pub input_sequence: u64,
        /// Arrival of that sample at the producing process on `CLOCK_MONOTONIC` \[ns\]; 0 if it came
        /// with a state, or within one process.
        #[machine]
        pub receive_mono_ns: u64,
        /// Intended release on `CLOCK_MONOTONIC` \[ns\]; in lockstep the instant the step became due.
        #[machine]
        pub release_mono_ns: u64,
        /// Start of the producing step on `CLOCK_MONOTONIC` \[ns\].
        #[machine]
        pub start_mono_ns: u64,
        /// Publication on `CLOCK_MONOTONIC` \[ns\].
        #[machine]
        pub publish_mono_ns: u64,
        /// Seat of the producer within its slot; 0 where a topic has one producer.
        pub seat: u32,
        /// How many times the producing process has been restarted.
        #[machine]
        pub generation: u32,
    }
}

sample! {
    /// Unit quaternion, Hamilton convention, scalar first, `w >= 0` on the wire.
    pub struct Quaternion {
        /// Scalar part.
        pub w: f64,
        /// First vector component.
        pub x: f64,
        /// Second vector component.
        pub y: f64,
        /// Third vector component.
        pub z: f64,
    }
}

impl Quaternion {
    /// No rotation.
    pub const IDENTITY: Self = Self { w: 1.0, x: 0.0, y: 0.0, z: 0.0 };

    /// Components, scalar first.
    #[must_use]
    pub const fn to_array(self) -> [f64; 4] {
        [self.w, self.x, self.y, self.z]
    }

    /// Of components, scalar first.
    #[must_use]
    pub const fn from_array([w, x, y, z]: [f64; 4]) -> Self {
        Self { w, x, y, z }
    }
}

crate::code! {
    /// A truth value that survives any bit pattern.
    pub enum Flag {
        /// False.
        No = 0,
        /// True.
        Yes = 1,
    }
}

impl Flag {
    /// True unless the code is zero.
    #[must_use]
    pub const fn is_set(self) -> bool {
        self.0 != 0
    }
}

impl From<bool> for Flag {
    fn from(value: bool) -> Self {
        if value { Self::Yes } else { Self::No }
    }
}

/// A struct that travels on a topic: its first field is the [`Header`].
pub trait Sample: Shared + Send + Sync {
    /// The header.
    fn header(&self) -> &Header;
    /// The header, for the runtime to fill in.
    fn header_mut(&mut self) -> &mut Header;
    /// Logical instant that the content describes \[ns\]. A producer whose own inputs stop may publish
    /// punctually what is old: consumers judge age by this instant, not by that of the publication.
    fn described_ns(&self) -> u64 {
        self.header().valid_ns
    }
}

macro_rules! samples {
    ($($name:ty),+ $(,)?) => { $(
        impl Sample for $name {
            fn header(&self) -> &Header {
                &self.header
            }
            fn header_mut(&mut self) -> &mut Header {
                &mut self.header
            }
        }
    )+ };
}

samples!(
    crate::Imu,
    crate::PoseFix,
    crate::MorphAngle,
    crate::Barometer,
    crate::RangeFinder,
    crate::Reference,
    crate::MorphCommand,
    crate::AttitudeSetpoint,
    crate::AppliedSetpoint,
    crate::WrenchCommand,
    crate::AttitudeReport,
    crate::PositionReport,
    crate::AppliedCommand,
    crate::Truth,
    crate::ActuatorState,
    crate::Disturbance,
    crate::Trip,
    crate::OwnerRecord,
    crate::LoopStats,
    crate::Deviation,
    crate::Seating,
    crate::GuidanceOrder,
    crate::DisturbanceOrder,
);
