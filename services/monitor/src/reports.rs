//! Whether the attitude slot's owner obeys the position slot, and says truly which set point it tracks.
//!
//! A position controller continues from the set point that the attitude slot reports, and the criteria measure the
//! vehicle against it, so that a false report misleads both. Here it is compared with the samples of the set points
//! themselves. An owner that reports the right set point and flies another one is found by its attitude.

use runtime::obey::LIMITED_FOR_NS;
use shared_types::{NO_SEAT, TripCause};
use vehicle::wrap_pi;

/// Set points that are known, of all seats of the position slot that may command.
const KNOWN: usize = 16;
/// After a change of hands the limiter keeps the tracked set point near the old one; twice as long as it does so,
/// because the new owner has yet to speak \[ns\].
const SETTLES_NS: u64 = 2 * LIMITED_FOR_NS;
/// Reports in a row that name no set point that there is, or one that is long over: one alone may be told late.
const UNFOUND: u64 = 3;
/// Rounding of values that are handed through \[rad, N\].
const EQUAL: f64 = 1e-9;

shared_types::memory! {
    /// A set point of the position slot.
    #[derive(PartialEq)]
    pub struct Asked {
        /// Roll, pitch and yaw \[rad\], and collective thrust \[N\].
        pub value: [f64; 4],
        /// Its sequence; 0 for none.
        pub sequence: u64,
        /// When it takes effect \[ns\].
        pub valid_ns: u64,
        /// Seat of its writer.
        pub seat: u32,
    }
}

shared_types::memory! {
    /// A [`Reports`] as plain numbers.
    #[derive(PartialEq)]
    pub struct ReportsMemory {
        /// Latest set points, the oldest of which makes room.
        pub asked: [Asked; KNOWN],
        /// How many there have been.
        pub count: u64,
        /// Value of the last report that was found true.
        pub tracked: [f64; 4],
        /// By how much it differed from its set point: what the limiter takes out of a change of hands.
        pub left: [f64; 4],
        /// Whether there is one.
        pub has_tracked: bool,
        /// Reports in a row without a set point that they can mean.
        pub unfound: u64,
        /// Owner and fallback of the position slot, [`NO_SEAT`] for none.
        pub hands: [u32; 2],
        /// Since when they are these \[ns\].
        pub changed_ns: u64,
        /// Owner of the position slot that has tripped; [`NO_SEAT`] for none.
        pub tripped: u32,
        /// Its trip's effective instant \[ns\].
        pub tripped_ns: u64,
    }
}

/// What the attitude slot's owner reports of its set point in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Said {
    /// Release of the step \[ns\].
    pub release_ns: u64,
    /// Seat whose set points it obeys.
    pub seat: u32,
    /// Sequence of the set point that it tracks; 0 before the first.
    pub sequence: u64,
    /// Roll, pitch and yaw \[rad\], and collective thrust \[N\].
    pub value: [f64; 4],
    /// Period of its loop \[ns\].
    pub period_ns: u64,
    /// Period of the position loop \[ns\].
    pub asks_every_ns: u64,
    /// Seat of the position slot's fallback; [`NO_SEAT`] for none.
    pub fallback: u32,
}

/// Compares reports with set points. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone)]
pub struct Reports {
    thrust_max_n: f64,
    memory: ReportsMemory,
}

/// Difference of two set points in magnitude, component by component.
fn apart(one: &[f64; 4], other: &[f64; 4]) -> [f64; 4] {
    let [roll, pitch, yaw, thrust] = core::array::from_fn(|i| one[i] - other[i]);
    [roll, pitch, wrap_pi(yaw), thrust].map(f64::abs)
}

impl Reports {
    /// Of a vehicle whose rotors give this thrust together \[N\].
    #[must_use]
    pub fn new(thrust_max_n: f64) -> Self {
        let hands = [NO_SEAT; 2];
        let memory = ReportsMemory { hands, tripped: NO_SEAT, ..ReportsMemory::default() };
        Self { thrust_max_n, memory }
    }

    /// Takes a set point of a controller that may command the position slot, all of it finite.
    pub fn ask(&mut self, asked: Asked) {
        let [roll, pitch, yaw, thrust_n] = asked.value;
        // What the rotors cannot give is not tracked.
        let value = [roll, pitch, yaw, thrust_n.clamp(0.0, self.thrust_max_n)];
        #[expect(clippy::cast_possible_truncation, reason = "a remainder below KNOWN")]
        let place = (self.memory.count % KNOWN as u64) as usize;
        self.memory.asked[place] = Asked { value, ..asked };
        self.memory.count += 1;
    }

    /// Takes owner and fallback of the position slot by the record that is in effect since `at_ns`; true if they are
    /// others than before.
    pub fn take_hands(&mut self, hands: [u32; 2], at_ns: u64) -> bool {
        let has_changed = hands != self.memory.hands;
        if has_changed {
            self.memory.hands = hands;
            self.memory.changed_ns = at_ns;
            self.memory.tripped = NO_SEAT;
        }
        has_changed
    }

    /// Says that another controller flies the attitude slot: what the last one reported is not its.
    pub fn forget(&mut self) {
        self.memory.unfound = 0;
        self.memory.left = [0.0; 4];
        self.memory.has_tracked = false;
    }

    /// Says that the position slot's owner on `seat` has tripped, in effect at `at_ns`.
    pub fn trip(&mut self, seat: u32, at_ns: u64) {
        self.memory.tripped = seat;
        self.memory.tripped_ns = at_ns;
    }

    /// What is wrong with a report, if something is.
    pub fn hear(&mut self, said: &Said) -> Option<TripCause> {
        if said.sequence == 0 {
            return None;
        }
        if self.ignores_trip(said) {
            return Some(TripCause::TripIgnored);
        }
        self.is_false(said).then_some(TripCause::ReportFalse)
    }

    /// The tripped owner is obeyed two periods after its trip, although the fallback is there.
    fn ignores_trip(&self, said: &Said) -> bool {
        let memory = &self.memory;
        let due_ns = memory.tripped_ns.saturating_add(2 * said.period_ns);
        let speaks = |asked: &Asked| {
            asked.sequence > 0
                && asked.seat == said.fallback
                && asked.valid_ns + 2 * said.asks_every_ns > memory.tripped_ns
                && asked.valid_ns <= due_ns
        };
        memory.tripped != NO_SEAT
            && said.seat == memory.tripped
            && said.release_ns > due_ns
            && said.fallback != NO_SEAT
            && memory.asked.iter().any(speaks)
    }

    fn is_false(&mut self, said: &Said) -> bool {
        let settles = said.release_ns < self.memory.changed_ns.saturating_add(SETTLES_NS);
        let tracked = self.memory.has_tracked.then_some(self.memory.tracked);
        // Before a new owner speaks, the one before is still obeyed, with a sequence of its own.
        let mut meant =
            self.memory.asked.iter().filter(|asked| asked.sequence == said.sequence).peekable();
        if meant.peek().is_none() {
            return self.is_unfound();
        }
        let left = meant.clone().find_map(|asked| {
            let left = apart(&asked.value, &said.value);
            // The limiter comes from what was tracked before, and never goes away from the set point. Without a report
            // before this one it may come from anywhere.
            let from = tracked.map_or([f64::INFINITY; 4], |from| apart(&asked.value, &from));
            let may_be = |i: usize| {
                let limited = if settles { from[i].max(self.memory.left[i]) } else { 0.0 };
                left[i] <= limited + EQUAL
            };
            (0..4).all(may_be).then_some(left)
        });
        let Some(left) = left else { return true };
        // A newer one has been there for more than two periods, and it is not taken.
        let limit_ns = 2 * said.asks_every_ns + said.period_ns;
        let is_over = |asked: &Asked| {
            self.memory.asked.iter().any(|newer| {
                newer.seat == asked.seat
                    && newer.sequence > asked.sequence
                    && newer.valid_ns > asked.valid_ns
                    && newer.valid_ns.saturating_add(limit_ns) < said.release_ns
            })
        };
        if meant.all(is_over) {
            return self.is_unfound();
        }
        self.memory.unfound = 0;
        self.memory.tracked = said.value;
        self.memory.left = left;
        self.memory.has_tracked = true;
        false
    }

    fn is_unfound(&mut self) -> bool {
        self.memory.unfound += 1;
        self.memory.unfound >= UNFOUND
    }

    /// State between two steps.
    #[must_use]
    pub fn memory(&self) -> ReportsMemory {
        self.memory
    }

    /// Continues from a state, bit for bit.
    pub fn restore(&mut self, memory: &ReportsMemory) {
        self.memory = *memory;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const ASKS_EVERY_NS: u64 = 20_000_000;
    const PERIOD_NS: u64 = 10_000_000;

    fn asked(seat: u32, sequence: u64, thrust_n: f64) -> Asked {
        let valid_ns = sequence * ASKS_EVERY_NS;
        Asked { value: [0.1, -0.1, 3.0, thrust_n], sequence, valid_ns, seat }
    }

    fn said(of: &Asked) -> Said {
        Said {
            release_ns: of.valid_ns,
            seat: of.seat,
            sequence: of.sequence,
            value: of.value,
            period_ns: PERIOD_NS,
            asks_every_ns: ASKS_EVERY_NS,
            fallback: 1,
        }
    }

    /// Long after the last change of hands, with set points 101 to 110 of seat 0 and of its fallback on seat 1.
    fn reports() -> Reports {
        let mut reports = Reports::new(4.0);
        assert!(reports.take_hands([0, 1], 0) && !reports.take_hands([0, 1], 9));
        for sequence in 101..=110 {
            reports.ask(asked(0, sequence, 1.0));
            reports.ask(asked(1, sequence, 1.5));
            assert_eq!(reports.hear(&said(&asked(0, sequence, 1.0))), None);
        }
        reports
    }

    #[test]
    fn a_report_of_another_value_than_the_set_point_it_names_is_false() {
        let truth = said(&asked(0, 110, 1.0));
        for axis in 0..4 {
            let mut value = truth.value;
            value[axis] += 1e-6;
            let found = reports().hear(&Said { value, ..truth });
            assert_eq!(found, Some(TripCause::ReportFalse), "axis {axis}");
        }
        let turned = [0.1, -0.1, 3.0 - core::f64::consts::TAU, 1.0];
        assert_eq!(reports().hear(&Said { value: turned, ..truth }), None, "the same heading");
        let none = Said { sequence: 0, value: [0.0; 4], ..truth };
        assert_eq!(reports().hear(&none), None, "no set point yet");
    }

    #[test]
    fn a_set_point_beyond_what_the_rotors_give_is_tracked_at_their_bound() {
        let mut reports = reports();
        reports.ask(asked(0, 111, 9.0));
        assert_eq!(reports.hear(&said(&asked(0, 111, 4.0))), None);
    }

    #[test]
    fn a_report_that_stays_at_a_set_point_that_is_over_is_false() {
        let mut reports = reports();
        let frozen = said(&asked(0, 106, 1.0));
        let found = (0..10).map(|step| {
            let release_ns = asked(0, 108, 1.0).valid_ns + step * PERIOD_NS;
            reports.hear(&Said { release_ns, ..frozen })
        });
        // 107 has been there for two periods of the position loop and one of its own; then three in a row.
        let first = found.into_iter().position(|cause| cause == Some(TripCause::ReportFalse));
        assert_eq!(first, Some(6));
    }

    #[test]
    fn a_set_point_that_nobody_has_given_is_forgiven_twice_and_not_three_times() {
        let mut reports = reports();
        let forged = Said { sequence: 1000, ..said(&asked(0, 110, 1.0)) };
        assert_eq!([reports.hear(&forged), reports.hear(&forged)], [None; 2]);
        assert_eq!(reports.hear(&said(&asked(0, 110, 1.0))), None);
        assert_eq!([reports.hear(&forged), reports.hear(&forged)], [None; 2]);
        assert_eq!(reports.hear(&forged), Some(TripCause::ReportFalse));
    }

    #[test]
    fn after_a_change_of_hands_a_report_may_lie_between_the_set_points_for_a_while() {
        let change_ns = asked(0, 110, 1.0).valid_ns;
        let between = Said { value: [0.1, -0.1, 3.0, 1.2], ..said(&asked(1, 110, 1.5)) };
        assert_eq!(reports().hear(&between), Some(TripCause::ReportFalse));
        let mut changed = reports();
        assert!(changed.take_hands([1, 0], change_ns));
        assert_eq!(changed.hear(&between), None);
        let outside = Said { value: [0.0; 4], ..between };
        assert_eq!(changed.hear(&outside), Some(TripCause::ReportFalse));
        let late = Said { release_ns: change_ns + SETTLES_NS, ..between };
        assert_eq!(changed.hear(&late), Some(TripCause::ReportFalse));
    }

    #[test]
    fn a_trip_has_to_be_obeyed_within_two_periods_if_there_is_a_fallback() {
        let mut reports = reports();
        let owner = said(&asked(0, 110, 1.0));
        let trip_ns = owner.release_ns;
        reports.trip(0, trip_ns);
        let at = |periods: u64, fallback: u32| Said {
            release_ns: trip_ns + periods * PERIOD_NS,
            fallback,
            ..owner
        };
        assert_eq!(reports.hear(&at(2, 1)), None);
        assert_eq!(reports.hear(&at(3, 1)), Some(TripCause::TripIgnored));
        assert_eq!(reports.hear(&at(3, NO_SEAT)), None, "no fallback");
        assert_eq!(reports.hear(&at(3, 2)), None, "a fallback that says nothing");
        let obeys = Said { release_ns: at(3, 1).release_ns, ..said(&asked(1, 110, 1.5)) };
        assert_eq!(reports.hear(&obeys), None);
        assert!(reports.take_hands([1, 0], trip_ns));
        assert_eq!(reports.hear(&at(3, 1)), None, "of an owner that is none any more");
    }
}
