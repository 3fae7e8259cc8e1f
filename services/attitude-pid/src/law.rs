//! One step of the law.

use controller::attitude::{AttitudeLaw, Common, Sample, Timing};
use controller::{OutOfRange, within};
use nalgebra::Vector3;

shared_types::memory! {
    /// The law's whole evolving memory.
    #[derive(PartialEq)]
    pub struct Memory {
        /// Set point, torques, counters.
        pub common: Common,
        /// Integral of the rate error \[N m\].
        pub integral_nm: [f64; 3],
        /// Derivative part, filtered \[rad/s²\].
        pub derivative_rad_s2: [f64; 3],
        /// γ̇(k−1) \[rad/s\].
        pub rate_rad_s: [f64; 3],
        /// Torque as the law would have had it \[N m\].
        pub wish_nm: [f64; 3],
    }
}

/// The complete configuration of the law, for roll, pitch and yaw.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct PidConfig {
    /// Times on the way of a command; the period is the control period.
    pub timing: Timing,
    /// Time constant asked of the rate loop \[s\], before its delay.
    pub rate_time_s: [f64; 3],
    /// Rate set point per angle error, times what the rate loop takes.
    pub angle_ratio: f64,
    /// Integral time of the rate error over what the rate loop takes.
    pub integral_ratio: f64,
    /// Largest rate set point \[rad/s\].
    pub rate_max_rad_s: f64,
    /// Share of the torque that a turn may need to be braked in time.
    pub braking_share: f64,
    /// Derivative time over that of its filter.
    pub filter_ratio: f64,
    /// Time \[s\] in which the integral takes back what bounds and rotors did not give.
    pub windup_s: f64,
}

impl PidConfig {
    fn validate(&self) -> Result<(), OutOfRange> {
        within("rate_hz", 1.0 / self.timing.period_s, 1.0, 1000.001)?;
        within("rotor_lag_s", self.timing.rotor_lag_s, 0.0, 1.0)?;
        within("wrench_latency_s", self.timing.latency_s, 0.0, 1.0)?;
        for time_s in self.rate_time_s {
            within("rate_time_s", time_s, 1e-4, 100.0)?;
        }
        within("angle_ratio", self.angle_ratio, 1e-3, 1.0)?;
        within("integral_ratio", self.integral_ratio, 0.1, 1e6)?;
        within("rate_max_rad_s", self.rate_max_rad_s, 1e-2, 1e3)?;
        within("braking_share", self.braking_share, 1e-3, 1.0)?;
        within("filter_ratio", self.filter_ratio, 1.0, 1e3)?;
        within("windup_s", self.windup_s, 1e-3, 1e3)
    }

    /// What the rate loop takes \[s\]: T + θ with θ the command's delay and half a period of holding it.
    fn pace_s(&self, axis: usize) -> f64 {
        self.rate_time_s[axis] + self.timing.latency_s + 0.5 * self.timing.period_s
    }
}

/// The attitude PID.
#[derive(Debug)]
pub struct PidLaw {
    config: PidConfig,
    windup_share: f64,
    integral: Vector3<f64>,
    derivative: Vector3<f64>,
    rate: Vector3<f64>,
    wish: Vector3<f64>,
}

impl PidLaw {
    /// At rest.
    ///
    /// # Errors
    /// A number outside its range.
    pub fn new(config: PidConfig) -> Result<Self, OutOfRange> {
        config.validate()?;
        let windup_share = -libm::expm1(-config.timing.period_s / config.windup_s);
        let zero = Vector3::zeros();
        Ok(Self { config, windup_share, integral: zero, derivative: zero, rate: zero, wish: zero })
    }

    /// Rate set point \[rad/s\] for an angle `error` \[rad\], where `acceleration` \[rad/s²\] can brake.
    ///
    /// Proportional, up to the rate from which a share of the torque still stops at the set point.
    fn rate_setpoint(&self, axis: usize, error: f64, acceleration: f64) -> f64 {
        let most = self.config.braking_share * acceleration;
        let braked = (2.0 * most * error.abs()).sqrt();
        let gain = self.config.angle_ratio / self.config.pace_s(axis);
        let rate = (gain * error.abs()).min(braked);
        -rate.min(self.config.rate_max_rad_s).copysign(error)
    }
}

impl AttitudeLaw for PidLaw {
    type Memory = Memory;

    fn torque(&mut self, sample: &Sample) -> Vector3<f64> {
        let config = &self.config;
        let (period, lag) = (config.timing.period_s, config.timing.rotor_lag_s);
        let filter = lag / config.filter_ratio;
        // While tracking, all of it: the next torque continues from the applied one.
        let share = if sample.tracking { 1.0 } else { self.windup_share };
        for axis in 0..3 {
            let inertia = sample.inertia_kg_m2[axis];
            let rate = sample.gamma_rate_rad_s[axis];
            // SIMC for an integrator behind a lag and a delay [Skogestad]: K = 1/(T + θ), T_d the lag, and
            // an integral time in proportion to T + θ.
            let pace = config.pace_s(axis);
            let (proportional, integral_s) = (1.0 / pace, config.integral_ratio * pace);
            if sample.follows {
                // Back-calculation [Astrom, Hagglund] 3.5.
                let lacking = sample.applied_nm[axis] - self.wish[axis];
                self.integral[axis] += share * lacking;
                // The derivative of the measurement, so that set points do not kick; [Astrom, Hagglund] 3.4.
                let change = rate - self.rate[axis];
                let kick = proportional * lag * change;
                let was = filter * self.derivative[axis];
                self.derivative[axis] = (was - kick) / (filter + period);
            } else {
                self.integral[axis] = sample.applied_nm[axis];
                self.derivative[axis] = 0.0;
            }
            let acceleration = sample.bound_nm[axis] / inertia;
            let wanted = self.rate_setpoint(axis, sample.error_rad[axis], acceleration);
            let error = wanted - rate;
            let answer = proportional * error + self.derivative[axis];
            self.wish[axis] = inertia * answer + self.integral[axis];
            self.integral[axis] += inertia * proportional / integral_s * error * period;
            self.rate[axis] = rate;
        }
        self.wish
    }

    fn memory(&self, common: &Common) -> Memory {
        Memory {
            common: *common,
            integral_nm: self.integral.into(),
            derivative_rad_s2: self.derivative.into(),
            rate_rad_s: self.rate.into(),
            wish_nm: self.wish.into(),
        }
    }

    fn restore(&mut self, memory: &Memory) -> Result<Common, String> {
        let parts =
            [memory.integral_nm, memory.derivative_rad_s2, memory.rate_rad_s, memory.wish_nm];
        if !parts.iter().flatten().all(|number| number.is_finite()) {
            return Err("it holds a number that is not finite".to_owned());
        }
        [self.integral, self.derivative, self.rate, self.wish] = parts.map(Vector3::from);
        Ok(memory.common)
    }
}
