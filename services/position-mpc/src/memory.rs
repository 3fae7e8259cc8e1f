//! Everything the law remembers from one sample to the next.

use mpc::ROW_CAPACITY;

use crate::transport::HISTORY;

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
        /// False until a setpoint was commanded.
        pub commanded: bool,
        /// x(k−1) = \[p, v, (θ₀, φ₀, T₀) as achieved, u(k−2)\], SI, W axes.
        pub state: [f64; 12],
        /// Open-loop copy of T₀ at the last sample \[N\].
        pub thrust_n: f64,
        /// Last command: (θ₀, φ₀, T₀), \[1, 1, N\].
        pub command: [f64; 3],
        /// Inputs as applied, u(k−1), u(k−2), …, where the last step was that of k.
        pub inputs: [[f64; 3]; HISTORY],
        /// ψ \[rad\] by which the last command was rotated.
        pub heading_rad: f64,
        /// Setpoints (φ, θ, ψ, T), the last one first, \[rad, rad, rad, N\].
        pub setpoints: [[f64; 4]; HISTORY],
        /// Whether the next step follows another controller, see [`PositionLaw::track`](crate::PositionLaw::track).
        pub tracks: bool,
        /// Whether another controller has lost the vehicle, which is still far from its path.
        pub catches: bool,
        /// Where the path back to the reference is beside it at the last sample, see [`PositionLaw::track`](crate::PositionLaw::track) \[m\].
        pub beside_w_m: [f64; 3],
        /// Position \[m\] to hold when the reference ends.
        pub hold_w_m: [f64; 3],
        /// Bound each row of the program was held at, packed.
        pub working_set: [u64; ROW_CAPACITY / 32],
        /// What happened so far.
        pub counters: Counters,
    }
}

impl Memory {
    /// Hovering at trim, u(−1) = (0, 0, m g).
    pub(crate) fn at_trim(weight_n: f64) -> Self {
        Self {
            primed: false,
            commanded: false,
            state: [0.0; 12],
            thrust_n: weight_n,
            command: [0.0, 0.0, weight_n],
            inputs: [[0.0, 0.0, weight_n]; HISTORY],
            heading_rad: 0.0,
            setpoints: [[0.0, 0.0, 0.0, weight_n]; HISTORY],
            tracks: false,
            catches: false,
            beside_w_m: [0.0; 3],
            hold_w_m: [0.0; 3],
            working_set: [0; ROW_CAPACITY / 32],
            counters: Counters::default(),
        }
    }
}
