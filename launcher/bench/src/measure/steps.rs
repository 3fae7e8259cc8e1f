//! One loop: when its steps should have begun, when they did, on what, and for how long.

use super::Window;
use crate::series::Series;
use observe::stopwatch::{Stamp, Stopwatch};
use runtime::rate::Rate;
use shared_types::{Role, topics};

/// Figures of a loop, in the order in which they are shown.
pub const FIGURES: [&str; 6] = ["lateness", "period", "age", "hop", "wait", "compute"];

/// A step on the time line: instant \[s\], lateness and compute time \[us\].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Moment {
    /// Logical time \[s\].
    pub t_s: f64,
    /// From the intended release to the start.
    pub lateness_us: f64,
    /// From the start to publication.
    pub compute_us: f64,
}

/// Durations of the steps of a loop.
#[derive(Debug, Clone, Default)]
pub struct Steps {
    /// Steps that ran.
    pub ran: u64,
    /// First and last release of them \[ns\].
    pub span_ns: [u64; 2],
    /// Steps that were published after the next release.
    pub overruns: u64,
    /// From the intended release to the start; releases that were left out count as late as the step
    /// that ran instead.
    pub lateness: Series,
    /// How far each period from start to start was from the intended one.
    pub period: Series,
    /// From publication of the IMU sample that the step goes by to its start.
    pub age: Series,
    /// From publication of the newest sample of its first input to its arrival.
    pub hop: Series,
    /// From arrival, or from the release if that was later, to the start.
    pub wait: Series,
    /// From the start to publication.
    pub compute: Series,
    /// From what began the step to its start: the release for a loop of its own clock, else that or the publication of its
    /// newest input, whichever was later.
    pub begin: Series,
    /// Step by step.
    pub moments: Vec<Moment>,
}

impl Steps {
    /// Of a loop on a seat: after the warm-up if `warm`, else in it.
    #[must_use]
    pub fn of(
        watch: &Stopwatch,
        (role, seat): (Role, u32),
        rate: Rate,
        window: &Window,
        warm: bool,
    ) -> Self {
        let stamps = stamps(watch, role, seat);
        let inputs = input_of(role).and_then(|topic| watch.stamps.get(topic));
        let inputs = inputs.map(|inputs| by_sequence(inputs)).unwrap_or_default();
        let imu = watch.stamps.get(topics::IMU.info.name).map(|imu| by_sequence(imu));
        let imu = imu.unwrap_or_default();
        let mut steps = Self::default();
        let mut before: Option<&Stamp> = None;
        for stamp in &stamps {
            if window.is_warm(stamp.release_ns) == warm {
                steps.take(stamp, before, rate);
                steps.take_input(stamp, before, &inputs);
                if let Some(begun_ns) = begun_ns(stamp, role, &inputs) {
                    steps.begin.record(stamp.start_mono_ns.saturating_sub(begun_ns));
                }
                if role != Role::Plant
                    && let Some(imu) = find(&imu, stamp.cause_sequence)
                {
                    steps.age.record(stamp.start_mono_ns.saturating_sub(imu.publish_mono_ns));
                }
            }
            before = Some(stamp);
        }
        steps
    }

    fn take(&mut self, stamp: &Stamp, before: Option<&Stamp>, rate: Rate) {
        if self.ran == 0 {
            self.span_ns[0] = stamp.release_ns;
        }
        self.ran += 1;
        self.span_ns[1] = stamp.release_ns;
        let late_ns = stamp.start_mono_ns.saturating_sub(stamp.release_mono_ns);
        let compute_ns = stamp.publish_mono_ns.saturating_sub(stamp.start_mono_ns);
        self.lateness.record(late_ns);
        self.compute.record(compute_ns);
        self.overruns += u64::from(late_ns + compute_ns > rate.period_ns());
        self.moments.push(Moment {
            t_s: stamp.release_ns as f64 * 1e-9,
            lateness_us: late_ns as f64 * 1e-3,
            compute_us: compute_ns as f64 * 1e-3,
        });
        let Some(before) = before else { return };
        // Without these a loop that stands still would look well.
        let left_out =
            rate.first_at_or_after(before.release_ns) + 1..rate.first_at_or_after(stamp.release_ns);
        for index in left_out {
            let earlier_ns = stamp.release_ns.saturating_sub(rate.release_ns(index));
            self.lateness.record(late_ns + earlier_ns);
        }
        let intended_ns = stamp.release_mono_ns.saturating_sub(before.release_mono_ns);
        let flown_ns = stamp.start_mono_ns.saturating_sub(before.start_mono_ns);
        self.period.record(flown_ns.abs_diff(intended_ns));
    }

    fn take_input(&mut self, stamp: &Stamp, before: Option<&Stamp>, inputs: &[Stamp]) {
        let is_new = before.is_none_or(|before| before.input_sequence != stamp.input_sequence);
        if stamp.receive_mono_ns == 0 || !is_new {
            return;
        }
        if let Some(input) = find(inputs, stamp.input_sequence) {
            self.hop.record(stamp.receive_mono_ns.saturating_sub(input.publish_mono_ns));
        }
        let ready_ns = stamp.receive_mono_ns.max(stamp.release_mono_ns);
        self.wait.record(stamp.start_mono_ns.saturating_sub(ready_ns));
    }

    /// Releases that were due: from the first step to the last, or in all of the window if no other
    /// process could have run them.
    #[must_use]
    pub fn due(&self, rate: Rate, window: &Window, alone: bool) -> u64 {
        let [first_ns, last_ns] = self.span_ns;
        let [from_ns, until_ns] =
            if alone { [window.warm_ns, window.end_ns] } else { [first_ns, last_ns + 1] };
        rate.first_at_or_after(until_ns).saturating_sub(rate.first_at_or_after(from_ns))
    }

    /// A figure by name.
    #[must_use]
    pub fn figure(&self, name: &str) -> Option<&Series> {
        Some(match name {
            "lateness" => &self.lateness,
            "period" => &self.period,
            "age" => &self.age,
            "hop" => &self.hop,
            "wait" => &self.wait,
            "compute" => &self.compute,
            _ => return None,
        })
    }
}

/// When a step had what begins it \[ns\]; nothing is known of one without its input.
fn begun_ns(stamp: &Stamp, role: Role, inputs: &[Stamp]) -> Option<u64> {
    if !(role.is_slot() || role == Role::Estimator) {
        return Some(stamp.release_mono_ns);
    }
    let input = find(inputs, stamp.input_sequence)?;
    Some(input.publish_mono_ns.max(stamp.release_mono_ns))
}

/// Topic of the first input of a role's services.
fn input_of(role: Role) -> Option<&'static str> {
    match role {
        Role::Plant => Some(topics::WRENCH_COMMAND.info.name),
        Role::Estimator => Some(topics::IMU.info.name),
        role if role.is_slot() => Some(topics::STATE_ESTIMATE.info.name),
        _ => None,
    }
}

/// Every step of a loop once, in order: the topic with the most samples covers all steps.
pub(crate) fn stamps(watch: &Stopwatch, role: Role, seat: u32) -> Vec<Stamp> {
    let of_role = topics::all().into_iter().filter(|topic| topic.from == role);
    let of_seat = of_role.filter_map(|topic| {
        let stamps = watch.stamps.get(topic.name)?.iter();
        Some(stamps.filter(|stamp| stamp.seat == seat).copied().collect::<Vec<_>>())
    });
    // Of two as long the first, so that the same stamps give the same steps.
    let longest =
        |best: Vec<Stamp>, next: Vec<Stamp>| if next.len() > best.len() { next } else { best };
    let mut longest = of_seat.fold(Vec::new(), longest);
    longest.sort_by_key(|stamp| stamp.release_ns);
    longest.dedup_by_key(|stamp| stamp.release_ns);
    longest
}

/// In the order of their sequences.
pub(super) fn by_sequence(stamps: &[Stamp]) -> Vec<Stamp> {
    let mut stamps = stamps.to_vec();
    stamps.sort_by_key(|stamp| stamp.sequence);
    stamps
}

/// The one of this sequence, among those in order.
pub(super) fn find(stamps: &[Stamp], sequence: u64) -> Option<&Stamp> {
    let at = stamps.binary_search_by_key(&sequence, |stamp| stamp.sequence).ok()?;
    stamps.get(at)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeMap;

    const WINDOW: Window = Window { warm_ns: 0, start_mono_ns: 0, end_ns: 1_000_000_000 };

    fn step(sequence: u64, release_us: u64, late_us: u64, compute_us: u64) -> Stamp {
        let release_mono_ns = 1_000_000 + release_us * 1000;
        let start_mono_ns = release_mono_ns + late_us * 1000;
        Stamp {
            sequence,
            release_ns: release_us * 1000,
            release_mono_ns,
            start_mono_ns,
            publish_mono_ns: start_mono_ns + compute_us * 1000,
            ..Stamp::default()
        }
    }

    fn watch(stamps: Vec<Stamp>) -> Stopwatch {
        let stamps = BTreeMap::from([(topics::STATE_ESTIMATE.info.name, stamps)]);
        Stopwatch::of_stamps(stamps)
    }

    fn khz() -> Rate {
        Rate::from_hz(1000.0).unwrap()
    }

    #[test]
    fn lateness_counts_from_the_intended_release_and_for_releases_that_were_left_out() {
        // Releases 2 and 3 were skipped: the step at 4 ms began 0.1 ms late.
        let flown = watch(vec![step(1, 0, 10, 5), step(2, 1000, 20, 5), step(3, 4000, 100, 5)]);
        let steps = Steps::of(&flown, (Role::Estimator, 0), khz(), &WINDOW, true);
        assert_eq!((steps.ran, steps.lateness.len()), (3, 5));
        let lateness = steps.lateness.quantiles().unwrap();
        assert!((lateness.max_us - 2100.0).abs() < 3.0, "{lateness:?}");
        // 1 ms + 10 us and 3 ms + 80 us instead of whole milliseconds.
        let periods: Vec<_> = steps.period.bins().map(|(ns, n)| (ns / 1000, n)).collect();
        assert_eq!(periods, [(10, 1), (80, 1)]);
        // Ten were due until 10 ms, and five of them until the last step.
        let window = Window { end_ns: 10_000_000, ..WINDOW };
        assert_eq!([true, false].map(|alone| steps.due(khz(), &window, alone)), [10, 5]);
    }

    #[test]
    fn a_step_that_ends_after_the_next_release_is_an_overrun() {
        let flown = watch(vec![step(1, 0, 10, 980), step(2, 1000, 30, 980)]);
        let steps = Steps::of(&flown, (Role::Estimator, 0), khz(), &WINDOW, true);
        assert_eq!(steps.overruns, 1);
    }

    #[test]
    fn hop_wait_and_age_follow_the_samples_by_their_sequences() {
        let imu = Stamp { publish_mono_ns: 1_050_000, ..step(7, 0, 0, 0) };
        let estimate = Stamp {
            cause_sequence: 7,
            input_sequence: 7,
            receive_mono_ns: 1_070_000,
            ..step(1, 0, 75, 5)
        };
        // The same input again is no new arrival.
        let again = Stamp { receive_mono_ns: 1_070_000, input_sequence: 7, ..step(2, 1000, 1, 5) };
        let mut flown = watch(vec![estimate, again]);
        flown.stamps.insert(topics::IMU.info.name, vec![imu]);
        let steps = Steps::of(&flown, (Role::Estimator, 0), khz(), &WINDOW, true);
        let only =
            |series: &Series| series.bins().map(|(ns, n)| (ns / 1000, n)).collect::<Vec<_>>();
        assert_eq!(only(&steps.hop), [(20, 1)]);
        assert_eq!(only(&steps.wait), [(5, 1)]);
        assert_eq!(only(&steps.age), [(25, 1)]);
        // From the publication of the sample, and from the release after it.
        assert_eq!(only(&steps.begin), [(1, 1), (25, 1)]);
        assert_eq!(steps.figure("compute").map(Series::len), Some(2));
    }

    #[test]
    fn warm_up_is_apart() {
        let window = Window { warm_ns: 1_000_000, ..WINDOW };
        let flown = watch(vec![step(1, 0, 900, 5), step(2, 1000, 3, 5), step(3, 2000, 3, 5)]);
        let role = (Role::Estimator, 0);
        let [warm, cold] = [true, false].map(|w| Steps::of(&flown, role, khz(), &window, w));
        assert_eq!((warm.ran, cold.ran), (2, 1));
        assert!(warm.lateness.quantiles().unwrap().max_us < 4.0);
    }
}
