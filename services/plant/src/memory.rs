//! Everything the plant remembers from one step to the next.

use crate::gate::GateMemory;
use crate::sensors::SensorsMemory;
use runtime::ArbiterMemory;
use shared_types::NO_SEAT;
use vehicle::MODEL_MEMORY_LEN;

shared_types::memory! {
    /// A command, with the seat that gave it.
    #[derive(PartialEq)]
    pub struct InEffect {
        /// Seat of its writer.
        pub seat: u32,
        pub sequence: u64,
        /// Sequence of the IMU sample that it descends from.
        pub cause_sequence: u64,
    }
}

impl InEffect {
    /// No command yet.
    pub(crate) const NONE: Self = Self { seat: NO_SEAT, sequence: 0, cause_sequence: 0 };
}

shared_types::memory! {
    /// Everything that evolves.
    pub struct PlantMemory {
        /// Equations of motion.
        pub model: [f64; MODEL_MEMORY_LEN],
        pub sensors: SensorsMemory,
        /// Actuation gate.
        pub gate: GateMemory,
        /// The seat whose command counts.
        pub arbiter: ArbiterMemory,
        /// Instant up to which the vehicle has been integrated \[ns\].
        pub integrated_ns: u64,
        /// Whether `reading` holds the inertial reading of that instant.
        pub has_reading: bool,
        /// Gyro \[rad/s\] and specific force \[m/s²\] of that reading.
        pub reading: [f64; 6],
        /// Last encoder reading \[rad\].
        pub measured_morph_rad: f64,
        /// Sequence of the last inertial sample.
        pub imu_sequence: u64,
        /// Command in effect, or the last that was.
        pub in_effect: InEffect,
        /// Body-rate jump still to be applied \[rad/s\].
        pub kick_b_rad_s: [f64; 3],
    }
}
