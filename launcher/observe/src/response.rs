//! How the attitude answered a step of the set point, for flights without a position loop.

use nalgebra::Vector3;
use shared_types::{AttitudeSetpoint, Truth};
use vehicle::{euler_from_quaternion, rotation, wrap_pi};

/// Half width of the band that counts as settled \[rad\].
pub const SETTLED_RAD: f64 = 0.004;
/// Attitudes kept; a minute at 1 kHz.
const CAPACITY: usize = 60_000;

/// Answer of one axis to the last change of the set point.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct AxisResponse {
    /// Set point \[rad\].
    pub target_rad: f64,
    /// From the change until the angle stays within [`SETTLED_RAD`] \[s\]; none if it never does.
    pub settling_s: Option<f64>,
    /// Largest angle in the direction of the step \[rad\].
    pub peak_rad: f64,
    /// Error at the end \[rad\].
    pub final_error_rad: f64,
}

/// Attitudes and set points of a flight.
#[derive(Debug, Clone, Default)]
pub struct StepResponse {
    attitudes: Vec<(u64, Vector3<f64>)>,
    /// Instant and value of the last change of the set point.
    step: Option<(u64, Vector3<f64>)>,
    setpoint: Option<Vector3<f64>>,
}

impl StepResponse {
    /// Takes note of the real attitude.
    pub fn observe_truth(&mut self, truth: &Truth) {
        if self.attitudes.len() < CAPACITY {
            let q = rotation(truth.q_wb.to_array());
            self.attitudes.push((truth.header.valid_ns, euler_from_quaternion(&q)));
        }
    }

    /// Takes note of a set point.
    pub fn observe_setpoint(&mut self, sample: &AttitudeSetpoint) {
        let gamma = Vector3::new(sample.roll_rad, sample.pitch_rad, sample.yaw_rad);
        if self.setpoint.replace(gamma).is_some_and(|before| before != gamma) {
            self.step = Some((sample.header.valid_ns, gamma));
        }
    }

    /// Roll, pitch and yaw after the last change; none if the set point never changed.
    #[must_use]
    pub fn axes(&self) -> Option<[AxisResponse; 3]> {
        let (at_ns, target) = self.step?;
        let after: Vec<_> = self.attitudes.iter().filter(|(t_ns, _)| *t_ns >= at_ns).collect();
        let start = after.first()?.1;
        Some(core::array::from_fn(|axis| {
            let error = |gamma: &Vector3<f64>| wrap_pi(gamma[axis] - target[axis]);
            let towards = if target[axis] < start[axis] { -1.0 } else { 1.0 };
            let unsettled = after.iter().rposition(|(_, g)| error(g).abs() > SETTLED_RAD);
            let settled_ns = match unsettled {
                None => Some(at_ns),
                Some(last) => after.get(last + 1).map(|(t_ns, _)| *t_ns),
            };
            AxisResponse {
                target_rad: target[axis],
                settling_s: settled_ns.map(|t_ns| (t_ns - at_ns) as f64 * 1e-9),
                peak_rad: towards
                    * after.iter().map(|(_, g)| towards * g[axis]).fold(f64::MIN, f64::max),
                final_error_rad: after.last().map_or(f64::NAN, |(_, g)| error(g)),
            }
        }))
    }
}

#[cfg(test)]
#[expect(
    clippy::disallowed_methods,
    reason = "an oracle shares no function with the code under test"
)]
mod tests {
    use super::*;
    use vehicle::quaternion_from_euler;

    #[test]
    fn an_exponential_answer_settles_when_the_exponential_does() {
        let mut response = StepResponse::default();
        let setpoint = |t_ms: u64, roll_rad: f64| {
            let mut sample = AttitudeSetpoint { roll_rad, ..AttitudeSetpoint::default() };
            sample.header.valid_ns = t_ms * 1_000_000;
            sample
        };
        response.observe_setpoint(&setpoint(0, 0.0));
        response.observe_setpoint(&setpoint(100, 0.2));
        for t_ms in 0..1000_u64 {
            let t_s = t_ms.saturating_sub(100) as f64 * 1e-3;
            let roll = 0.2 * (1.0 - (-t_s / 0.05).exp());
            let q = quaternion_from_euler(&Vector3::new(roll, 0.0, 0.0));
            let q_wb = shared_types::Quaternion::from_array(vehicle::components(q));
            let mut truth = Truth { q_wb, ..Truth::default() };
            truth.header.valid_ns = t_ms * 1_000_000;
            response.observe_truth(&truth);
        }
        let [roll, pitch, _] = response.axes().unwrap();
        // 0.2 exp(-t / 0.05) = 0.004 at t = 0.05 ln 50.
        assert!((roll.settling_s.unwrap() - 0.05 * 50.0_f64.ln()).abs() <= 1e-3);
        assert!((roll.peak_rad - 0.2).abs() < 1e-6 && roll.final_error_rad.abs() < 1e-6);
        assert_eq!(pitch.settling_s, Some(0.0));
    }

    #[test]
    fn an_answer_that_never_settles_is_reported_as_such() {
        let mut response = StepResponse::default();
        let mut setpoint = AttitudeSetpoint::default();
        response.observe_setpoint(&setpoint);
        setpoint.roll_rad = 0.2;
        response.observe_setpoint(&setpoint);
        response
            .observe_truth(&Truth { q_wb: shared_types::Quaternion::IDENTITY, ..Truth::default() });
        assert_eq!(response.axes().unwrap()[0].settling_s, None);
    }
}
