//! Applies a fault to a command.

use crate::received::Received;
use crate::{Entry, Fault};
use shared_types::{AppliedSetpoint, Flag, StateEstimate};
use std::collections::VecDeque;
use vehicle::{euler_from_quaternion, rotation};

/// Number of past commands that are kept for a delay, more than any entry needs.
const KEPT: usize = 1024;
/// Rate above which the arms count as moving \[rad/s\].
const MOVES_RAD_S: f64 = 0.2;
/// How long [`Fault::Sways`] stays on each side \[s\].
const SWAY_S: f64 = 0.05;

/// The part of the estimate on which faults depend.
#[derive(Debug, Clone, Copy, Default, PartialEq)]
pub struct Seen {
    /// Angle between body z and the vertical \[rad\].
    pub tilt_rad: f64,
    /// Rate of the morph angle \[rad/s\].
    pub morph_rate_rad_s: f64,
    /// Heading of body x \[rad\].
    pub heading_rad: f64,
}

impl From<&StateEstimate> for Seen {
    fn from(estimate: &StateEstimate) -> Self {
        let q = &estimate.q_wb;
        // 1 − 2 (x² + y²) is the cosine of the tilt.
        let half = (q.x * q.x + q.y * q.y).sqrt().min(1.0);
        let heading_rad = euler_from_quaternion(&rotation(q.to_array())).z;
        let tilt_rad = 2.0 * libm::asin(half);
        Self { tilt_rad, morph_rate_rad_s: estimate.morph_rate_rad_s, heading_rad }
    }
}

/// Applies a fault to the commands of one controller. The components of a command are thrust, roll, pitch and
/// yaw.
#[derive(Debug, Clone)]
pub struct Spoiler {
    entry: Entry,
    /// Largest command. Its thrust is the weight, which is also the trim.
    largest: [f64; 4],
    /// Instant of the first command \[ns\].
    began_ns: Option<u64>,
    /// The command with which the fault began.
    first: Option<[f64; 4]>,
    /// The report with which it began.
    reported: Option<AppliedSetpoint>,
    morphed: bool,
    past: VecDeque<(u64, [f64; 4])>,
}

impl Spoiler {
    /// Applies the fault of `entry`; `largest` is the largest command of its slot: the weight \[N\], then
    /// torques \[N m\] or angles \[rad\].
    #[must_use]
    pub fn new(entry: Entry, largest: [f64; 4]) -> Self {
        let past = VecDeque::with_capacity(KEPT);
        Self { entry, largest, began_ns: None, first: None, reported: None, morphed: false, past }
    }

    /// The entry with the fault that is applied.
    #[must_use]
    pub fn entry(&self) -> &Entry {
        &self.entry
    }

    /// The command with the fault, in place of the good `command` of the step at `now_ns` \[ns\]. Both have
    /// the units of the largest command.
    pub fn spoil(&mut self, now_ns: u64, command: [f64; 4], seen: Seen) -> [f64; 4] {
        let Some(faulty_s) = self.faulty_s(now_ns) else {
            return command;
        };
        let first = *self.first.get_or_insert(command);
        self.morphed |= seen.morph_rate_rad_s.abs() > MOVES_RAD_S;
        let [weight, most_roll, most_pitch, _] = self.largest;
        let [thrust, roll, pitch, yaw] = command;
        let amount = self.entry.amount;
        let turned = [thrust, -roll, -pitch, yaw];
        let biased =
            |share: f64| [thrust, roll + share * most_roll, pitch + share * most_pitch, yaw];
        match self.entry.fault {
            Fault::WrongSign => {
                let mut wrong = command;
                let axis = self.entry.axis.min(3);
                wrong[axis] = if axis == 0 { 2.0 * weight - thrust } else { -command[axis] };
                wrong
            }
            Fault::Exchanged => [thrust, pitch, roll, yaw],
            Fault::Gain => {
                [weight + amount * (thrust - weight), amount * roll, amount * pitch, amount * yaw]
            }
            Fault::Frozen => first,
            Fault::Delay => self.late(now_ns, command, amount),
            Fault::NotANumber => [thrust, f64::NAN, pitch, yaw],
            Fault::Bias => biased(amount),
            Fault::Diverges if seen.tilt_rad.to_degrees() > amount => turned,
            Fault::UntilMorph if self.morphed => turned,
            Fault::Leak => biased(amount * faulty_s),
            Fault::Thrust => [amount * weight, roll, pitch, yaw],
            Fault::Slams | Fault::SlamsAndReportsZero => match self.entry.axis {
                1 => [2.0 * weight, amount * most_roll, pitch, yaw],
                2 => [2.0 * weight, roll, amount * most_pitch, yaw],
                _ => [2.0 * weight, amount * most_roll, amount * most_pitch, yaw],
            },
            Fault::WorldFrame => {
                let (sin, cos) = libm::sincos(seen.heading_rad);
                [thrust, cos * roll - sin * pitch, sin * roll + cos * pitch, yaw]
            }
            Fault::Sways => {
                let side = if (faulty_s / SWAY_S).floor() % 2.0 == 0.0 { amount } else { -amount };
                [thrust, side * most_roll, side * most_pitch, yaw]
            }
            Fault::Spins => [thrust, roll, pitch, yaw + amount * faulty_s],
            // The others are about reports, inputs or time, or do not show yet.
            _ => command,
        }
    }

    /// For how long the fault has been there at `now_ns`, the instant of a command \[ns\]; none before it begins.
    fn faulty_s(&mut self, now_ns: u64) -> Option<f64> {
        let flown_ns = now_ns.saturating_sub(*self.began_ns.get_or_insert(now_ns));
        let faulty_s = flown_ns as f64 * 1e-9 - self.entry.after_s;
        (faulty_s >= 0.0).then_some(faulty_s)
    }

    /// The report of the set point with the fault, in place of the good one of the step at `now_ns` \[ns\].
    pub fn report(&mut self, now_ns: u64, report: AppliedSetpoint) -> AppliedSetpoint {
        if self.faulty_s(now_ns).is_none() {
            return report;
        }
        let of = |thrust_n: f64, roll_rad: f64, pitch_rad: f64, yaw_rad: f64| AppliedSetpoint {
            thrust_n,
            roll_rad,
            pitch_rad,
            yaw_rad,
            ..report
        };
        match self.entry.fault {
            Fault::ReportsZero | Fault::SlamsAndReportsZero => of(0.0, 0.0, 0.0, 0.0),
            Fault::ReportsFrozen => *self.reported.get_or_insert(report),
            Fault::ReportsNoThrust => of(0.0, report.roll_rad, report.pitch_rad, report.yaw_rad),
            Fault::ReportsFailOver => AppliedSetpoint { failed_over: Flag::Yes, ..report },
            Fault::ReportsTrip => AppliedSetpoint { tripped: Flag::Yes, ..report },
            Fault::ReportsEpoch => AppliedSetpoint { epoch: u64::MAX, ..report },
            Fault::ReportsRefusal => {
                let AppliedSetpoint { epoch, .. } = *self.reported.get_or_insert(report);
                let refused_epoch = if report.epoch > epoch { report.epoch } else { 0 };
                AppliedSetpoint { epoch, refused_epoch, ..report }
            }
            _ => report,
        }
    }

    /// What of its inputs the controller gets in the step at `now_ns` \[ns\]; `None` if all.
    pub fn receives(&mut self, now_ns: u64) -> Option<Received> {
        let faulty_s = self.faulty_s(now_ns);
        let all = Received { trips: true, references: true, east_m: 0.0 };
        match self.entry.fault {
            Fault::IgnoresTrips => Some(Received { trips: false, ..all }),
            Fault::NoReferences => Some(Received { references: faulty_s.is_none(), ..all }),
            Fault::WalksAway => {
                Some(Received { east_m: -self.entry.amount * faulty_s.unwrap_or(0.0), ..all })
            }
            _ => None,
        }
    }

    /// True if nothing is to be published of the step at `now_ns` \[ns\].
    pub fn is_silent(&mut self, now_ns: u64) -> bool {
        self.entry.fault == Fault::Silent && self.faulty_s(now_ns).is_some()
    }

    /// True if the process is to end in the step at `now_ns` \[ns\].
    pub fn ends(&mut self, now_ns: u64) -> bool {
        self.entry.fault == Fault::Exits && self.faulty_s(now_ns).is_some()
    }

    fn late(&mut self, now_ns: u64, command: [f64; 4], delay_s: f64) -> [f64; 4] {
        if self.past.len() == KEPT {
            self.past.pop_front();
        }
        self.past.push_back((now_ns, command));
        let due = |(at_ns, _): &&(u64, [f64; 4])| {
            now_ns.saturating_sub(*at_ns) as f64 * 1e-9 >= delay_s - 1e-9
        };
        let found = self.past.iter().rev().find(due).or_else(|| self.past.front());
        found.map_or(command, |(_, command)| *command)
    }
}

#[cfg(test)]
#[expect(clippy::float_cmp, reason = "numbers that are passed on as they are")]
mod tests {
    use super::*;

    const LARGEST: [f64; 4] = [1.0, 0.1, 0.1, 0.02];
    const COMMAND: [f64; 4] = [1.1, 0.01, -0.02, 0.003];

    fn spoiled(fault: Fault, axis: usize, amount: f64, seen: Seen) -> [f64; 4] {
        let entry = Entry { fault, axis, amount, ..Entry::default() };
        Spoiler::new(entry, LARGEST).spoil(0, COMMAND, seen)
    }

    #[test]
    fn each_fault_changes_the_command_by_its_name() {
        let still = Seen::default();
        assert_eq!(spoiled(Fault::Nothing, 0, 0.0, still), COMMAND);
        assert_eq!(spoiled(Fault::WrongSign, 1, 0.0, still), [1.1, -0.01, -0.02, 0.003]);
        assert!((spoiled(Fault::WrongSign, 0, 0.0, still)[0] - 0.9).abs() < 1e-12);
        assert_eq!(spoiled(Fault::Exchanged, 0, 0.0, still), [1.1, -0.02, 0.01, 0.003]);
        assert!((spoiled(Fault::Gain, 0, 3.0, still)[0] - 1.3).abs() < 1e-12);
        assert!((spoiled(Fault::Bias, 0, 0.2, still)[1] - 0.03).abs() < 1e-12);
        let tilted = Seen { tilt_rad: 0.2, ..still };
        assert_eq!(spoiled(Fault::Slams, 1, 1.0, still), [2.0, 0.1, -0.02, 0.003]);
        let west = Seen { heading_rad: core::f64::consts::FRAC_PI_2, ..still };
        let turned = spoiled(Fault::WorldFrame, 0, 0.0, west);
        assert!((turned[1] - 0.02).abs() < 1e-12 && (turned[2] - 0.01).abs() < 1e-12);
        assert_eq!(spoiled(Fault::Diverges, 0, 10.0, still), COMMAND);
        assert_eq!(spoiled(Fault::Diverges, 0, 10.0, tilted), [1.1, -0.01, 0.02, 0.003]);
    }

    #[test]
    fn faults_that_depend_on_time_or_motion_appear_when_they_should() {
        let of = |fault, amount| Spoiler::new(Entry { fault, amount, ..Entry::default() }, LARGEST);
        let after = |fault, amount, after_s| {
            let entry = Entry { fault, amount, ..Entry::default() };
            Spoiler::new(entry.after(after_s), LARGEST)
        };
        let still = Seen::default();
        let mut late = of(Fault::Delay, 0.03);
        for step in 0..10_u32 {
            let command = [f64::from(step); 4];
            let delayed = late.spoil(u64::from(step) * 10_000_000, command, still);
            assert_eq!(delayed[0], f64::from(step.saturating_sub(3)));
        }
        let mut nan = after(Fault::NotANumber, 0.0, 0.7);
        assert_eq!(nan.spoil(0, COMMAND, still), COMMAND);
        assert!(nan.spoil(700_000_000, COMMAND, still)[1].is_nan());
        let mut frozen = after(Fault::Frozen, 0.0, 1e-9);
        assert_eq!(frozen.spoil(0, [9.0; 4], still), [9.0; 4]);
        assert_eq!(frozen.spoil(2, COMMAND, still), frozen.spoil(5, [0.0; 4], still));
        let mut zeroed = after(Fault::ReportsZero, 0.0, 0.7);
        assert_eq!(zeroed.spoil(0, COMMAND, still), COMMAND);
        let good = AppliedSetpoint { thrust_n: 1.0, roll_rad: 0.1, ..AppliedSetpoint::default() };
        let said = |it: AppliedSetpoint| (it.thrust_n, it.roll_rad, it.failed_over.is_set());
        let reports = [699_999_999, 700_000_000].map(|t_ns| said(zeroed.report(t_ns, good)));
        assert_eq!(reports, [(1.0, 0.1, false), (0.0, 0.0, false)]);
        let mut against = after(Fault::ReportsFailOver, 0.0, 0.0);
        assert_eq!(said(against.report(0, good)), (1.0, 0.1, true));
        let mut stays = after(Fault::ReportsFrozen, 0.0, 0.0);
        let reports = [good, AppliedSetpoint::default()].map(|it| said(stays.report(0, it)));
        assert_eq!(reports, [(1.0, 0.1, false); 2]);
        let mut walks = after(Fault::WalksAway, 0.5, 1.0);
        let east_m = [0, 1_000_000_000, 3_000_000_000]
            .map(|t_ns| walks.receives(t_ns).map(|received| received.east_m));
        assert_eq!(east_m, [Some(0.0), Some(0.0), Some(-1.0)]);
        let mut ends = after(Fault::Exits, 0.0, 0.5);
        assert_eq!([0, 500_000_000].map(|t_ns| ends.ends(t_ns)), [false, true]);
        let mut climbs = after(Fault::Thrust, 4.0, 0.5);
        let mut spins = after(Fault::Spins, 1.0, 0.5);
        for t_ns in [0, 500_000_000, 1_500_000_000] {
            let (up, round) =
                (climbs.spoil(t_ns, COMMAND, still), spins.spoil(t_ns, COMMAND, still));
            assert_eq!(up[0], if t_ns == 0 { COMMAND[0] } else { 4.0 });
            assert!((round[3] - COMMAND[3] - (t_ns as f64 * 1e-9 - 0.5).max(0.0)).abs() < 1e-12);
        }
        let mut slams = after(Fault::Slams, -2.0, 0.5);
        assert_eq!(slams.spoil(0, COMMAND, still), COMMAND);
        assert_eq!(slams.spoil(500_000_000, COMMAND, still), [2.0, -0.2, -0.2, COMMAND[3]]);
        let mut sways = of(Fault::Sways, 1.0);
        let sides = [0, 49_000_000, 51_000_000, 101_000_000];
        let sides = sides.map(|t_ns| sways.spoil(t_ns, COMMAND, still)[1]);
        assert_eq!(sides, [0.1, 0.1, -0.1, 0.1]);
        let mut leak = of(Fault::Leak, 0.05);
        assert_eq!(leak.spoil(0, COMMAND, still), COMMAND);
        assert!((leak.spoil(2_000_000_000, COMMAND, still)[1] - 0.02).abs() < 1e-12);
        let mut folds = of(Fault::UntilMorph, 0.0);
        assert_eq!(folds.spoil(0, COMMAND, still), COMMAND);
        let moves = Seen { morph_rate_rad_s: -1.0, ..still };
        assert_eq!(folds.spoil(1, COMMAND, moves), [1.1, -0.01, 0.02, 0.003]);
        assert_eq!(folds.spoil(2, COMMAND, still), [1.1, -0.01, 0.02, 0.003]);
    }
}
