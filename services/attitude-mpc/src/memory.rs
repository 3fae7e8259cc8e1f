//! Everything the law remembers from one sample to the next.

use crate::ramp::Ramp;
use controller::attitude::Actuators;
use mpc::ROW_CAPACITY;

shared_types::memory! {
    /// What happened so far; carried over by a restore.
    #[derive(PartialEq, Eq)]
    pub struct Counters {
        /// Steps taken, refused ones included.
        pub steps: u64,
        /// Steps refused, see [`Refusal`](crate::Refusal).
        pub refused: u64,
        /// Steps whose move was clipped because the solver did not finish.
        pub fallbacks: u64,
        /// Steps in which an increment bound had to give way.
        pub relaxed: u64,
    }
}

shared_types::memory! {
    /// The law's whole evolving memory: plain arrays, so that it can be published as it is.
    ///
    /// An instance of the same configuration that restores it continues bit for bit.
    #[derive(PartialEq)]
    pub struct Memory {
        /// False before the first step and after a refused one: Δx is then taken as zero.
        pub primed: bool,
        /// γ(k−1) \[rad\].
        pub gamma_rad: [f64; 3],
        /// γ̇(k−1) \[rad/s\].
        pub gamma_rate_rad_s: [f64; 3],
        /// Torques commanded, applied and behind the rotors' lag.
        pub actuators: Actuators,
        /// Torque behind the lag as it entered x(k−1) \[N m\].
        pub previous_actuator_nm: [f64; 3],
        /// Applied torque as it entered x(k−1) \[N m\].
        pub previous_applied_nm: [f64; 3],
        /// Last commanded thrust \[N\].
        pub thrust_n: f64,
        /// Approach to the setpoint.
        pub ramp: Ramp,
        /// β \[rad\] the matrices were built for; 0, which no arm can have, before the first step.
        pub scheduled_rad: f64,
        /// β(k−1) \[rad\]; 0 before the first step.
        pub morph_angle_rad: f64,
        /// Bound each row of the program was held at, packed.
        pub working_set: [u64; ROW_CAPACITY / 32],
        /// What happened so far.
        pub counters: Counters,
    }
}

impl Memory {
    /// At trim: level, hovering on `thrust_n`, no torque.
    pub(crate) fn at_trim(thrust_n: f64) -> Self {
        Self {
            primed: false,
            gamma_rad: [0.0; 3],
            gamma_rate_rad_s: [0.0; 3],
            actuators: Actuators::at_rest(),
            previous_actuator_nm: [0.0; 3],
            previous_applied_nm: [0.0; 3],
            thrust_n,
            ramp: Ramp::default(),
            scheduled_rad: 0.0,
            morph_angle_rad: 0.0,
            working_set: [0; ROW_CAPACITY / 32],
            counters: Counters::default(),
        }
    }
}
