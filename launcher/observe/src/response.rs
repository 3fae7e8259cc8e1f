//! How the attitude answered a step of the set point, for flights without a position loop.

use ::verdict::worst;
use nalgebra::Vector3;
use shared_types::{AttitudeSetpoint, Truth};
use std::collections::VecDeque;
use vehicle::{euler_from_quaternion, rotation, wrap_pi};

/// Half width of the band that counts as settled \[rad\].
pub const SETTLED_RAD: f64 = 0.004;
/// Attitudes kept for a set point that is seen after them, a quarter of a second at 1 kHz.
const RECENT: usize = 256;

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

/// How the attitude follows the set points of a flight, however long that is.
#[derive(Debug, Clone, Default)]
pub struct StepResponse {
    /// The last attitudes, roll, pitch and yaw \[rad\], with their instants \[ns\].
    recent: VecDeque<(u64, Vector3<f64>)>,
    setpoint: Option<Vector3<f64>>,
    /// Since the last change of the set point.
    step: Option<Step>,
}

/// What the attitude has done since a change of the set point.
#[derive(Debug, Clone)]
struct Step {
    at_ns: u64,
    /// The set point before it.
    before: Vector3<f64>,
    target: Vector3<f64>,
    /// First attitude since then, and the answers.
    answer: Option<(Vector3<f64>, [AxisResponse; 3])>,
}

impl Step {
    fn observe(&mut self, t_ns: u64, gamma: &Vector3<f64>) {
        let Some(elapsed_ns) = t_ns.checked_sub(self.at_ns) else { return };
        let target = &self.target;
        let at_first = |axis: usize| AxisResponse {
            target_rad: target[axis],
            settling_s: Some(0.0),
            peak_rad: gamma[axis],
            final_error_rad: f64::NAN,
        };
        let (start, axes) =
            self.answer.get_or_insert_with(|| (*gamma, core::array::from_fn(at_first)));
        for (axis, response) in axes.iter_mut().enumerate() {
            let error_rad = wrap_pi(gamma[axis] - target[axis]);
            let towards = if target[axis] < start[axis] { -1.0 } else { 1.0 };
            response.final_error_rad = error_rad;
            response.peak_rad = towards * (towards * response.peak_rad).max(towards * gamma[axis]);
            let is_settled = error_rad.abs() <= SETTLED_RAD;
            let settled_s = response.settling_s.unwrap_or(elapsed_ns as f64 * 1e-9);
            response.settling_s = is_settled.then_some(settled_s);
        }
    }
}

impl StepResponse {
    /// Takes note of the real attitude.
    pub fn observe_truth(&mut self, truth: &Truth) {
        let q = rotation(truth.q_wb.to_array());
        let (t_ns, gamma) = (truth.header.valid_ns, euler_from_quaternion(&q));
        if self.recent.len() == RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back((t_ns, gamma));
        if let Some(step) = &mut self.step {
            step.observe(t_ns, &gamma);
        }
    }

    /// Takes note of a set point. The first one is a step if it is not level, which the vehicle is before.
    pub fn observe_setpoint(&mut self, sample: &AttitudeSetpoint) {
        let gamma = Vector3::new(sample.roll_rad, sample.pitch_rad, sample.yaw_rad);
        let before = self.setpoint.replace(gamma).unwrap_or_default();
        if before != gamma {
            let at_ns = sample.header.valid_ns;
            let mut step = Step { at_ns, before, target: gamma, answer: None };
            for (t_ns, gamma) in &self.recent {
                step.observe(*t_ns, gamma);
            }
            self.step = Some(step);
        }
    }

    /// Roll, pitch and yaw after the last change; none if the set point never changed.
    #[must_use]
    pub fn axes(&self) -> Option<[AxisResponse; 3]> {
        self.step.as_ref()?.answer.map(|(_, axes)| axes)
    }

    /// How far the last attitude is off the set point in force, along the worst axis \[rad\]; 0 before the first
    /// attitude.
    #[must_use]
    pub fn error_rad(&self) -> f64 {
        let Some((_, gamma)) = self.recent.back() else { return 0.0 };
        // A pilot runs ahead: a step that no attitude has come after is not in force yet.
        let in_force = self.step.as_ref().map(|step| match step.answer {
            Some(_) => step.target,
            None => step.before,
        });
        let error = gamma - in_force.unwrap_or_default();
        error.iter().map(|error_rad| wrap_pi(*error_rad).abs()).fold(0.0, worst)
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

    /// A vehicle at this roll angle.
    fn rolled(t_ns: u64, roll_rad: f64) -> Truth {
        let q = quaternion_from_euler(&Vector3::new(roll_rad, 0.0, 0.0));
        let q_wb = shared_types::Quaternion::from_array(vehicle::components(q));
        let mut truth = Truth { q_wb, ..Truth::default() };
        truth.header.valid_ns = t_ns;
        truth
    }

    #[test]
    fn a_step_at_the_beginning_of_a_flight_is_judged_like_any_other() {
        let mut response = StepResponse::default();
        response
            .observe_setpoint(&AttitudeSetpoint { roll_rad: 0.3, ..AttitudeSetpoint::default() });
        response.observe_truth(&rolled(0, 0.0));
        response.observe_truth(&rolled(1_000_000, 0.1));
        let [roll, ..] = response.axes().unwrap();
        assert_eq!(roll.settling_s, None);
        assert!((roll.final_error_rad + 0.2).abs() < 1e-12, "{roll:?}");
        assert!((response.error_rad() - 0.2).abs() < 1e-12);
    }

    #[test]
    fn a_level_set_point_is_no_step_and_the_error_beside_it_is_known() {
        let mut response = StepResponse::default();
        assert!(response.error_rad() < 1e-12);
        response.observe_setpoint(&AttitudeSetpoint::default());
        response.observe_truth(&rolled(0, -0.2));
        assert_eq!(response.axes(), None);
        assert!((response.error_rad() - 0.2).abs() < 1e-12);
        let mut ahead = AttitudeSetpoint { roll_rad: 0.5, ..AttitudeSetpoint::default() };
        ahead.header.valid_ns = 200_000_000;
        response.observe_setpoint(&ahead);
        assert!((response.error_rad() - 0.2).abs() < 1e-12, "it is not in force yet");
    }

    #[test]
    fn the_last_attitude_counts_however_long_the_flight() {
        let mut response = StepResponse::default();
        response.observe_setpoint(&AttitudeSetpoint::default());
        for t_ms in 0..=70_000 {
            response
                .observe_truth(&rolled(t_ms * 1_000_000, if t_ms < 69_990 { 0.0 } else { 0.1 }));
        }
        // It has been in force for eleven attitudes when it is read.
        let mut setpoint = AttitudeSetpoint { roll_rad: 0.1, ..AttitudeSetpoint::default() };
        setpoint.header.valid_ns = 69_980 * 1_000_000;
        response.observe_setpoint(&setpoint);
        response.observe_truth(&rolled(70_001_000_000, 0.1));
        let [roll, ..] = response.axes().unwrap();
        assert_eq!(roll.settling_s, Some(0.01));
        assert!(roll.final_error_rad.abs() < 1e-12 && (roll.peak_rad - 0.1).abs() < 1e-12);
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
