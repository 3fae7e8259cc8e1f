//! The ramp from one setpoint to the next, known over the whole horizon.

use std::f64::consts::TAU;

use nalgebra::Vector3;
use vehicle::wrap_pi;

shared_types::memory! {
    /// A straight approach to the latest setpoint, in memory as plain arrays.
    #[derive(PartialEq)]
    pub struct Ramp {
        /// γ \[rad\] where the approach began.
        pub from_rad: [f64; 3],
        /// γ \[rad\] of the setpoint.
        pub to_rad: [f64; 3],
        /// Time since it began \[s\].
        pub elapsed_s: f64,
    }
}

impl Ramp {
    /// At rest on a setpoint.
    pub(crate) fn at(gamma: &Vector3<f64>) -> Self {
        Self { from_rad: (*gamma).into(), to_rad: (*gamma).into(), elapsed_s: 0.0 }
    }

    /// Value `ahead_s` \[s\] from now for a ramp of `duration_s` \[s\]. Yaw takes the short way and
    /// may leave (−π, π] on it: over a horizon it must not jump by a turn.
    pub(crate) fn value(&self, ahead_s: f64, duration_s: f64) -> Vector3<f64> {
        let elapsed = self.elapsed_s + ahead_s;
        let from = Vector3::from(self.from_rad);
        let mut to = Vector3::from(self.to_rad);
        to.z += TAU * ((from.z - to.z) / TAU).round();
        if elapsed >= duration_s { to } else { from + (to - from) * (elapsed / duration_s) }
    }

    /// Takes the setpoint of this sample: a new one starts a new approach from here.
    pub(crate) fn aim(&mut self, setpoint: &Vector3<f64>, duration_s: f64) {
        if *setpoint != Vector3::from(self.to_rad) {
            let mut from = self.value(0.0, duration_s);
            from.z = wrap_pi(from.z);
            *self = Self { from_rad: from.into(), to_rad: (*setpoint).into(), elapsed_s: 0.0 };
        }
    }

    /// One period later.
    pub(crate) fn advance(&mut self, period_s: f64, duration_s: f64) {
        // Saturates, so that the memory of a long hover stays the same from sample to sample.
        self.elapsed_s = (self.elapsed_s + period_s).min(duration_s.max(0.0));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_ramp_is_straight_and_the_next_one_starts_where_it_is() {
        let mut ramp = Ramp::at(&Vector3::zeros());
        ramp.aim(&Vector3::new(0.2, -0.4, 0.0), 0.02);
        assert_eq!(ramp.value(0.0, 0.02), Vector3::zeros());
        assert!((ramp.value(0.005, 0.02) - Vector3::new(0.05, -0.1, 0.0)).norm() < 1e-15);
        ramp.advance(0.01, 0.02);
        ramp.aim(&Vector3::new(0.1, 0.0, 0.0), 0.02);
        assert!((ramp.value(0.0, 0.02) - Vector3::new(0.1, -0.2, 0.0)).norm() < 1e-15);
        assert_eq!(ramp.value(0.02, 0.02), Vector3::new(0.1, 0.0, 0.0));
    }

    #[test]
    fn yaw_ramps_the_short_way_round() {
        let mut ramp = Ramp::at(&Vector3::new(0.0, 0.0, 3.1));
        ramp.aim(&Vector3::new(0.0, 0.0, -3.1), 0.02);
        let halfway = ramp.value(0.01, 0.02).z;
        assert!((halfway - std::f64::consts::PI).abs() < 1e-12);
        // The end is the same heading, one turn on: no jump between two samples of a horizon.
        assert!((ramp.value(0.02, 0.02).z - (TAU - 3.1)).abs() < 1e-12);
    }

    #[test]
    fn without_a_duration_the_setpoint_is_a_step() {
        let mut ramp = Ramp::at(&Vector3::zeros());
        ramp.aim(&Vector3::repeat(0.2), 0.0);
        assert_eq!(ramp.value(0.0, 0.0), Vector3::repeat(0.2));
    }
}
