//! The torque behind the rotors' lag, and u(k−1), as far as the plant's reports show.

use crate::FlightFacts;
use mpc::LaggedAxis;
use nalgebra::Vector3;
use shared_types::Slot;

/// Rotor lags after which nothing is left of what was before them.
const SETTLED_LAGS: f64 = 40.0;
/// Far below any period \[s\]: 1/500 − 0.001 must count as 0.001.
const ROUNDING_S: f64 = 1e-9;

/// Times on the way of a command \[s\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Timing {
    /// Control period.
    pub period_s: f64,
    /// From a step to its command taking effect; modelled up to one period.
    pub latency_s: f64,
    /// Between the plant's reports of the applied torque.
    pub report_s: f64,
    pub rotor_lag_s: f64,
}

impl From<&FlightFacts> for Timing {
    /// At the usual rate of the slot.
    fn from(flight: &FlightFacts) -> Self {
        Self {
            period_s: 1.0 / flight.usual_rate_hz[Slot::Attitude],
            latency_s: flight.wrench_latency_s,
            report_s: 1.0 / flight.plant_rate_hz,
            rotor_lag_s: flight.vehicle.rotor_lag_s,
        }
    }
}

impl Timing {
    /// One axis of the sampled model (10) for the gain 1: angle, rate, lagged torque, u(k−1).
    #[must_use]
    pub fn axis(&self) -> LaggedAxis {
        let delay_s = self.latency_s.min(self.period_s);
        LaggedAxis { gain: 1.0, lag_s: self.rotor_lag_s, delay_s, drag_per_s: 0.0 }
    }

    /// True if no report is of u(k−1), because a command takes a whole period to take effect.
    fn reports_late(&self) -> bool {
        self.latency_s >= self.period_s
    }

    /// True if a report is of u(k−2): that command was in effect for all of the reported tick.
    fn reports_one_late(&self) -> bool {
        self.reports_late() && self.latency_s + self.report_s <= 2.0 * self.period_s + ROUNDING_S
    }

    /// True if a report is of u(k−1): the command was in effect for all of the reported tick.
    fn reports_in_time(&self) -> bool {
        self.latency_s + self.report_s <= self.period_s + ROUNDING_S
    }
}

shared_types::memory! {
    /// Open-loop copy of the actuators, brought in line with what was applied.
    #[derive(PartialEq)]
    pub struct Actuators {
        /// False until a torque was commanded.
        pub commanded: bool,
        /// Torque behind the lag at this sample \[N m\].
        pub torque_nm: [f64; 3],
        /// u(k−1) as applied \[N m\].
        pub applied_nm: [f64; 3],
        /// u(k−2) as applied \[N m\].
        pub before_nm: [f64; 3],
        /// Last command \[N m\].
        pub command_nm: [f64; 3],
    }
}

impl Actuators {
    /// No torque, never commanded.
    #[must_use]
    pub fn at_rest() -> Self {
        let zero = [0.0; 3];
        let (torque_nm, applied_nm, before_nm, command_nm) = (zero, zero, zero, zero);
        Self { commanded: false, torque_nm, applied_nm, before_nm, command_nm }
    }

    /// Brings the copy to this sample; `reported` is the torque of the plant's last whole tick, and `axis` how the
    /// actuators are modelled.
    ///
    /// A report that may be of u(k−1) or u(k−2) is not used. One that is of u(k−2) shows by how much
    /// the plant departs from what is commanded, and u(k−1) is taken to depart as much. One that is still
    /// older shows the torque in effect, and not u(k−1).
    pub fn follow(&mut self, reported: Option<Vector3<f64>>, timing: &Timing, axis: &LaggedAxis) {
        let reported = reported.filter(|torque| torque.iter().all(|t| t.is_finite()));
        if !self.commanded {
            // A successor starts from what its predecessor left in effect.
            let start = reported.map_or(self.command_nm, Into::into);
            (self.torque_nm, self.applied_nm, self.before_nm) = (start, start, start);
            self.command_nm = start;
            return;
        }
        let mut before = Vector3::from(self.applied_nm);
        let mut latest = Vector3::from(self.command_nm);
        if timing.reports_in_time() {
            latest = reported.unwrap_or(latest);
        } else if timing.reports_late()
            && let Some(reported) = reported
        {
            if timing.reports_one_late() {
                latest += reported - before;
            }
            before = reported;
        }
        for i in 0..3 {
            let early = axis.actuator_after(self.torque_nm[i], before[i], axis.delay_s);
            let rest_s = timing.period_s - axis.delay_s;
            self.torque_nm[i] = axis.actuator_after(early, latest[i], rest_s);
        }
        self.before_nm = before.into();
        self.applied_nm = latest.into();
    }

    /// Brings the copy over so many periods without a step, with the torque that the plant has reported in the last of
    /// them, or else the last command in effect.
    pub fn pass(&mut self, periods: u64, reported: Option<Vector3<f64>>, timing: &Timing) {
        let axis = timing.axis();
        let reported = reported.filter(|torque| torque.iter().all(|t| t.is_finite()));
        if let Some(torque) = reported.filter(|_| self.commanded) {
            // It has been in effect for all of the period, whatever of it the report is.
            (self.applied_nm, self.command_nm) = (torque.into(), torque.into());
        }
        #[expect(clippy::cast_possible_truncation, clippy::cast_sign_loss, reason = "positive")]
        let settled = libm::ceil(SETTLED_LAGS * axis.lag_s / timing.period_s) as u64 + 2;
        for _ in 0..periods.min(settled) {
            self.follow(None, timing, &axis);
        }
    }

    /// Takes u(k−1) from another controller, whose command the plant has applied, before
    /// [`follow`](Self::follow). A report of an earlier command is carried on by the increment that was chosen here at k−1.
    pub fn track(&mut self, applied: &Vector3<f64>, timing: &Timing) {
        if !self.commanded || !applied.iter().all(|t| t.is_finite()) {
            return;
        }
        let mut command = *applied;
        if timing.reports_late() {
            command += Vector3::from(self.command_nm) - Vector3::from(self.applied_nm);
            self.applied_nm = (*applied).into();
        }
        self.command_nm = command.into();
    }

    /// Remembers u(k).
    pub fn command(&mut self, torque: &Vector3<f64>) {
        self.commanded = true;
        self.command_nm = (*torque).into();
    }

    /// True if every number is finite.
    #[must_use]
    pub fn is_finite(&self) -> bool {
        let numbers = [self.torque_nm, self.applied_nm, self.before_nm, self.command_nm];
        numbers.iter().flatten().all(|number| number.is_finite())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: f64 = 1e-3;

    fn timing(period_s: f64) -> Timing {
        Timing { period_s, latency_s: MS, report_s: MS, rotor_lag_s: 15.0 * MS }
    }

    #[test]
    fn behind_the_lag_the_torque_is_the_closed_form_of_its_steps() {
        let timing = timing(10.0 * MS);
        let mut copy = Actuators::at_rest();
        copy.follow(None, &timing, &timing.axis());
        copy.command(&Vector3::new(1.0, -2.0, 0.5));
        copy.follow(None, &timing, &timing.axis());
        let expected = 1.0 - libm::exp(-9.0 / 15.0);
        assert!((copy.torque_nm[0] - expected).abs() < 1e-15);
        assert!((copy.torque_nm[1] + 2.0 * expected).abs() < 1e-15);
        copy.command(&Vector3::zeros());
        copy.follow(None, &timing, &timing.axis());
        // One millisecond more of the old command, then nine of none.
        let rising = 1.0 - libm::exp(-10.0 / 15.0);
        assert!((copy.torque_nm[0] - rising * libm::exp(-9.0 / 15.0)).abs() < 1e-15);
    }

    #[test]
    fn over_a_gap_the_torque_goes_on_to_what_is_in_effect() {
        for period_s in [10.0 * MS, 2.0 * MS, MS] {
            let timing = timing(period_s);
            let mut before = Actuators::at_rest();
            before.follow(None, &timing, &timing.axis());
            before.command(&Vector3::new(1.0, 0.0, 0.0));
            for (reported, expected) in [(None, 1.0), (Some(Vector3::zeros()), 0.0)] {
                let mut copy = before;
                copy.pass(u64::MAX, reported, &timing);
                assert!((copy.torque_nm[0] - expected).abs() < 1e-12, "{copy:?}");
                for periods in 1..5 {
                    let mut copy = before;
                    copy.pass(periods, reported, &timing);
                    assert_eq!(copy.applied_nm[0], expected, "{periods} of {period_s}");
                }
            }
            let (mut stepwise, mut at_once) = (before, before);
            at_once.pass(2, None, &timing);
            for _ in 0..2 {
                stepwise.follow(None, &timing, &timing.axis());
            }
            assert_eq!(at_once, stepwise);
        }
    }

    #[test]
    fn what_the_plant_did_not_give_is_known_at_every_rate_with_one_report_per_command() {
        for (period_s, steps) in [(10.0 * MS, 1), (2.0 * MS, 1), (MS, 2)] {
            let timing = timing(period_s);
            let mut copy = Actuators::at_rest();
            copy.follow(None, &timing, &timing.axis());
            // A plant that gives half of what is commanded.
            let mut reported = Vector3::zeros();
            for _ in 0..40 {
                copy.command(&Vector3::repeat(0.02));
                if steps == 1 {
                    reported = Vector3::repeat(0.01);
                }
                copy.follow(Some(reported), &timing, &timing.axis());
                reported = Vector3::repeat(0.01);
            }
            assert!((copy.applied_nm[0] - 0.01).abs() < 1e-15, "{period_s}: {copy:?}");
        }
    }

    #[test]
    fn a_report_that_is_of_either_command_is_not_used() {
        let timing = timing(1.5 * MS);
        let mut copy = Actuators::at_rest();
        copy.follow(None, &timing, &timing.axis());
        copy.command(&Vector3::repeat(0.02));
        copy.follow(Some(Vector3::repeat(7.0)), &timing, &timing.axis());
        assert_eq!(copy.applied_nm, [0.02; 3]);
        copy.track(&Vector3::repeat(0.03), &timing);
        copy.follow(Some(Vector3::repeat(7.0)), &timing, &timing.axis());
        assert_eq!(copy.applied_nm, [0.03; 3]);
    }

    #[test]
    fn a_report_from_more_than_two_periods_ago_shows_nothing_of_the_last_command() {
        let timing = Timing { latency_s: 2.5 * MS, ..timing(MS) };
        let (mut copy, axis) = (Actuators::at_rest(), timing.axis());
        copy.follow(None, &timing, &axis);
        copy.command(&Vector3::repeat(0.02));
        copy.follow(Some(Vector3::repeat(0.005)), &timing, &axis);
        assert_eq!((copy.applied_nm, copy.before_nm), ([0.02; 3], [0.005; 3]));
    }

    #[test]
    fn a_law_that_tracks_late_reports_carries_them_on_by_its_own_increments() {
        let timing = timing(MS);
        let (mut copy, axis) = (Actuators::at_rest(), timing.axis());
        copy.follow(None, &timing, &axis);
        copy.command(&Vector3::repeat(0.01));
        copy.follow(None, &timing, &axis);
        copy.command(&Vector3::repeat(0.012));
        // Another one's u(k−2), where this one had 0.01.
        let reported = Vector3::repeat(0.03);
        copy.track(&reported, &timing);
        copy.follow(Some(reported), &timing, &axis);
        assert!((copy.applied_nm[0] - 0.032).abs() < 1e-15, "{copy:?}");
        assert_eq!(copy.before_nm, [0.03; 3]);
    }
}
