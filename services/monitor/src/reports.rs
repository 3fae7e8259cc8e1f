//! Whether the attitude slot's owner follows the position slot, and reports correctly which set point it tracks.
//!
//! A position controller continues from the set point that the attitude slot reports, and the criteria measure the
//! vehicle against it, so that a false report misleads both. Here it is compared with the samples of the set points
//! themselves. An owner that reports the right set point and flies another one is found by its attitude.

use runtime::arbiter::LIMITED_FOR_NS;
use shared_types::{NO_SEAT, SEATS, TripCause};
use vehicle::wrap_pi;

/// Set points that are known of each seat.
const KNOWN: usize = 8;
/// Reports in a row that name no existing set point, or one that is long over: a single one may
/// come from a late record.
const UNFOUND: u64 = 3;
/// Records in a row that a report may say it has refused. Each is written for a later instant than the one before, and the
/// slot's owner could never be replaced if none were ever taken. The supervisor writes one more than the next before it
/// takes a swap back, for the controller that comes after this one.
const REFUSED: u64 = 3;
/// Time that a trip may take to be followed, if that is longer than two periods of the attitude
/// loop: in realtime the trip may arrive late \[ns\].
pub const FOLLOWED_WITHIN_NS: u64 = 20_000_000;
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
    }
}

shared_types::memory! {
    /// Set points of one seat.
    #[derive(PartialEq)]
    pub struct AskedBySeat {
        /// The latest, of which the oldest makes room.
        pub asked: [Asked; KNOWN],
        /// How many there have been.
        pub count: u64,
    }
}

shared_types::memory! {
    /// A [`Reports`] as plain numbers.
    #[derive(PartialEq)]
    pub struct ReportsMemory {
        /// Set points by the seat of their writer.
        pub seats: [AskedBySeat; SEATS],
        /// Value of the last report that was found true.
        pub tracked: [f64; 4],
        /// By how much it differed from its set point: what the limiter takes out of a change of hands.
        pub left: [f64; 4],
        /// Whether there is one.
        pub has_tracked: bool,
        /// Reports in a row without a set point that they can mean.
        pub unfound: u64,
        /// Epoch of the position slot's record.
        pub epoch: u64,
        /// Its owner and its fallback, [`NO_SEAT`] for none.
        pub hands: [u32; 2],
        /// Since when it is in effect \[ns\].
        pub changed_ns: u64,
        /// Owner of the position slot that has tripped; [`NO_SEAT`] for none.
        pub tripped: u32,
        /// Its trip's effective instant \[ns\].
        pub tripped_ns: u64,
        /// The period of its owner \[ns\].
        pub every_ns: u64,
        /// Effective instant of its owner's last set point, or of the record that made it the owner \[ns\].
        pub asked_ns: u64,
        /// Epoch in which its owner has last been silent for so long that it may have been left.
        pub lapsed: u64,
        /// Epoch of the last record that was reported as refused.
        pub refused: u64,
        /// Records in a row that were.
        pub refusals: u64,
    }
}

/// The record of the position slot that is in effect.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Record {
    pub epoch: u64,
    /// Owner and fallback, [`NO_SEAT`] for none.
    pub hands: [u32; 2],
    /// Since when it is in effect \[ns\].
    pub at_ns: u64,
    /// Period of the owner \[ns\].
    pub every_ns: u64,
}

/// What the attitude slot's owner reports of its set point in a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Report {
    /// Release of the step \[ns\].
    pub release_ns: u64,
    /// Seat whose set points it follows.
    pub seat: u32,
    /// Sequence of the set point that it tracks; 0 before the first.
    pub sequence: u64,
    /// Epoch of the position slot's record that it goes by.
    pub epoch: u64,
    /// Epoch of the last record that it has refused; 0 for none.
    pub refused_epoch: u64,
    /// Whether it follows the fallback of that record.
    pub has_failed_over: bool,
    /// Whether the owner of that record has tripped.
    pub has_tripped: bool,
    /// Roll, pitch and yaw \[rad\], and collective thrust \[N\].
    pub value: [f64; 4],
    /// Period of its loop \[ns\].
    pub period_ns: u64,
    /// Periods of the position slot's owner and fallback \[ns\]; 0 for none.
    pub asked_every_ns: [u64; 2],
}

/// Compares reports with set points. Of fixed size; nothing here allocates or panics.
#[derive(Debug, Clone)]
pub struct Reports {
    thrust_max_n: f64,
    memory: ReportsMemory,
}

/// What the known set points show about a report.
enum Judged {
    /// It cannot be compared yet, or not any more.
    Open,
    /// It is right, but for what the limiter takes out of a change of hands.
    True { left: [f64; 4] },
    /// There is no set point that it can mean, or that one is long over.
    Unfound,
    /// It names a set point that has another value.
    False,
}

/// Difference of two set points in magnitude, component by component.
fn apart(one: &[f64; 4], other: &[f64; 4]) -> [f64; 4] {
    let [roll, pitch, yaw, thrust] = core::array::from_fn(|i| one[i] - other[i]);
    [roll, pitch, wrap_pi(yaw), thrust].map(f64::abs)
}

impl ReportsMemory {
    /// From a set point of the position slot's owner until it counts as silent \[ns\].
    fn gap_ns(&self) -> u64 {
        self.every_ns.saturating_mul(3) / 2
    }
}

impl AskedBySeat {
    fn known(&self) -> impl Iterator<Item = &Asked> {
        self.asked.iter().filter(|asked| asked.sequence > 0)
    }
}

impl Reports {
    /// Of a vehicle whose rotors give this thrust together \[N\].
    #[must_use]
    pub fn new(thrust_max_n: f64) -> Self {
        let hands = [NO_SEAT; 2];
        let memory = ReportsMemory { hands, tripped: NO_SEAT, ..ReportsMemory::default() };
        Self { thrust_max_n, memory }
    }

    /// Whether no set point is known yet.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.memory.seats.iter().all(|seat| seat.count == 0)
    }

    fn by_seat(&self, seat: u32) -> Option<&AskedBySeat> {
        self.memory.seats.get(usize::try_from(seat).ok()?)
    }

    /// Takes a set point of the controller on `seat`, all of it finite.
    pub fn ask(&mut self, seat: u32, asked: Asked) {
        if seat == self.memory.hands[0] {
            self.note_silence(asked.valid_ns);
            self.memory.asked_ns = self.memory.asked_ns.max(asked.valid_ns);
        }
        let [roll, pitch, yaw, thrust_n] = asked.value;
        // What the rotors cannot give is not tracked.
        let value = [roll, pitch, yaw, thrust_n.clamp(0.0, self.thrust_max_n)];
        let by_seat = usize::try_from(seat).ok().and_then(|seat| self.memory.seats.get_mut(seat));
        let Some(by_seat) = by_seat else { return };
        #[expect(clippy::cast_possible_truncation, reason = "a remainder below KNOWN")]
        let place = (by_seat.count % KNOWN as u64) as usize;
        by_seat.asked[place] = Asked { value, ..asked };
        by_seat.count += 1;
    }

    /// Notes that the owner has asked for nothing until `until_ns`, if it could have: half a period before its consumers
    /// may leave it for its fallback, since they may have received less of it.
    pub fn note_silence(&mut self, until_ns: u64) {
        let memory = &mut self.memory;
        let has_fallback = memory.hands[1] != NO_SEAT;
        if has_fallback && until_ns > memory.asked_ns.saturating_add(memory.gap_ns()) {
            memory.lapsed = memory.epoch;
        }
    }

    /// Whether the position slot's fallback may be in command: its owner has tripped, or was silent for too long.
    #[must_use]
    pub fn may_have_failed_over(&self) -> bool {
        self.memory.tripped != NO_SEAT || self.memory.lapsed == self.memory.epoch
    }

    /// Takes the record of the position slot that is in effect; true if owner or fallback are others than before.
    pub fn take_record(&mut self, record: &Record) -> bool {
        let memory = &mut self.memory;
        let has_changed = record.hands != memory.hands;
        if memory.epoch == 0 && record.epoch > 1 {
            // What there was before this monitor is not known.
            memory.lapsed = record.epoch;
        }
        memory.every_ns = record.every_ns;
        if record.hands[0] != memory.hands[0] {
            // It is left as soon as what its predecessor asked for is over, which it did at its own rate.
            memory.asked_ns = record.at_ns.saturating_sub(memory.gap_ns());
        }
        if has_changed {
            memory.hands = record.hands;
            memory.tripped = NO_SEAT;
        }
        if record.epoch != self.memory.epoch {
            self.memory.epoch = record.epoch;
            // A record that came too late is repeated, for a later instant.
            self.memory.changed_ns = record.at_ns;
        }
        has_changed
    }

    /// Notes that another controller flies the attitude slot: the reports of the last one do not apply to it.
    pub fn forget(&mut self) {
        self.memory.unfound = 0;
        self.memory.refusals = 0;
        self.memory.left = [0.0; 4];
        self.memory.has_tracked = false;
    }

    /// Notes that the position slot's owner on `seat` has tripped, in effect at `at_ns`.
    pub fn trip(&mut self, seat: u32, at_ns: u64) {
        self.memory.tripped = seat;
        self.memory.tripped_ns = at_ns;
    }

    /// What is wrong with a report, if something is.
    pub fn check(&mut self, report: &Report) -> Option<TripCause> {
        if self.ignores_trip(report) {
            return Some(TripCause::TripIgnored);
        }
        self.count_refusals(report);
        let judged = match self.judge(report) {
            Judged::False => Judged::False,
            _ if self.misstates(report) => Judged::Unfound,
            judged => judged,
        };
        match judged {
            Judged::Open => None,
            Judged::True { left } => {
                self.memory.unfound = 0;
                self.memory.tracked = report.value;
                self.memory.left = left;
                self.memory.has_tracked = true;
                None
            }
            Judged::Unfound => {
                self.memory.unfound += 1;
                (self.memory.unfound >= UNFOUND).then_some(TripCause::ReportFalse)
            }
            Judged::False => Some(TripCause::ReportFalse),
        }
    }

    /// Says of the position slot what its records, trips and set points do not: another epoch, another seat than follows
    /// from that, a trip that there was not, or a fail-over although the owner has asked without a gap. It would cost the
    /// owner its slot, or give it a slot that it does not have.
    fn misstates(&self, report: &Report) -> bool {
        let memory = &self.memory;
        if report.epoch != memory.epoch {
            let within_ns = FOLLOWED_WITHIN_NS.max(2 * report.period_ns);
            // One that came too late for the loop is written again.
            let is_refused = report.refused_epoch == memory.epoch && memory.refusals <= REFUSED;
            return !is_refused && report.release_ns > memory.changed_ns.saturating_add(within_ns);
        }
        let [owner, fallback] = memory.hands;
        let followed = if report.has_failed_over { fallback } else { owner };
        let is_changed = report.has_tripped || report.has_failed_over;
        report.seat != followed || is_changed && !self.may_have_failed_over()
    }

    /// Counts the records that are reported as refused, until one is reported as taken.
    fn count_refusals(&mut self, report: &Report) {
        let memory = &mut self.memory;
        if report.refused_epoch != memory.refused && report.refused_epoch > 0 {
            memory.refused = report.refused_epoch;
            memory.refusals += 1;
        }
        if report.epoch == memory.epoch {
            memory.refusals = 0;
        }
    }

    /// The tripped owner is still followed when it should not be any more, although the fallback is there.
    fn ignores_trip(&self, report: &Report) -> bool {
        let memory = &self.memory;
        let [_, fallback] = memory.hands;
        let [_, fallback_every_ns] = report.asked_every_ns;
        // First it flies by its backup law, and names no set point, for two periods of the fallback.
        let backup_ns = if report.sequence == 0 { 2 * fallback_every_ns } else { 0 };
        let tripped_ns = memory.tripped_ns.saturating_add(backup_ns);
        let due_ns = tripped_ns.saturating_add(FOLLOWED_WITHIN_NS.max(2 * report.period_ns));
        // Usable in a step of the attitude loop between the trip and then.
        let counts = |asked: &Asked| {
            let from_ns = tripped_ns.max(asked.valid_ns);
            let until_ns = due_ns.min(asked.valid_ns.saturating_add(2 * fallback_every_ns));
            from_ns.saturating_add(report.period_ns) <= until_ns
        };
        memory.tripped != NO_SEAT
            && report.seat == memory.tripped
            && report.release_ns > due_ns
            && self.by_seat(fallback).is_some_and(|by_seat| by_seat.known().any(counts))
    }

    /// Compares a report with the set points that it can mean.
    fn judge(&self, report: &Report) -> Judged {
        let longest_ns = report.asked_every_ns[0].max(report.asked_every_ns[1]);
        // Until the new owner has published, and then until the limiter has given everything back.
        let limited_ns =
            LIMITED_FOR_NS.saturating_add(2 * longest_ns).saturating_add(report.period_ns);
        let settles = report.release_ns < self.memory.changed_ns.saturating_add(limited_ns);
        let overdue_ns = (2 * longest_ns).saturating_add(report.period_ns);
        let is_over = |newer: &Asked| newer.valid_ns.saturating_add(overdue_ns) < report.release_ns;
        let Some(of_seat) = self.by_seat(report.seat) else { return Judged::Unfound };
        if report.sequence == 0 && report.seat == self.memory.tripped {
            // Until there is another one to follow it tracks no set point.
            return Judged::Open;
        }
        if report.sequence == 0 && !settles && !self.memory.hands.contains(&report.seat) {
            return Judged::Unfound;
        }
        if report.sequence == 0 {
            // None is tracked before the first, and by the backup law, for want of another.
            let is_left_out = |asked: &Asked| {
                let held_until_ns = asked.valid_ns.saturating_add(4 * longest_ns);
                is_over(asked) && report.release_ns < held_until_ns
            };
            return if of_seat.known().any(is_left_out) { Judged::Unfound } else { Judged::Open };
        }
        if of_seat.known().all(|asked| asked.sequence > report.sequence)
            && of_seat.count > 0
            && !settles
        {
            // Older than all that is known: it cannot be compared.
            return if of_seat.known().any(is_over) { Judged::Unfound } else { Judged::Open };
        }
        // Before a new owner publishes, the one before is still followed, with a sequence of its own.
        let others = self.memory.seats.iter().enumerate().filter(|(seat, _)| {
            settles && *seat != report.seat as usize && *seat != self.memory.tripped as usize
        });
        let others = others.flat_map(|(_, by_seat)| by_seat.known());
        let meant = |asked: &&Asked| asked.sequence == report.sequence;
        let mut all = of_seat.known().chain(others).filter(meant).peekable();
        if all.peek().is_none() {
            return Judged::Unfound;
        }
        // One of those that it can mean makes it true.
        let left = all.find_map(|asked| {
            let left = apart(&asked.value, &report.value);
            let limited = if settles { self.limited(asked) } else { [0.0; 4] };
            (0..4).all(|i| left[i] <= limited[i] + EQUAL).then_some(left)
        });
        let Some(left) = left else { return Judged::False };
        // A newer one has been there for more than two periods, and it is not taken.
        let named_ns = of_seat.known().find(meant).map_or(u64::MAX, |asked| asked.valid_ns);
        let is_newer =
            |asked: &&Asked| asked.valid_ns > named_ns && asked.sequence > report.sequence;
        if of_seat.known().filter(is_newer).any(is_over) {
            return Judged::Unfound;
        }
        Judged::True { left }
    }

    /// By how much the limiter may keep the tracked set point away from `asked` after a change of hands: it begins at
    /// what was tracked or asked for before, and comes nearer from there. The heading is not limited.
    fn limited(&self, asked: &Asked) -> [f64; 4] {
        let tracked = self.memory.has_tracked.then_some(&self.memory.tracked);
        let known = self.memory.seats.iter().flat_map(AskedBySeat::known).map(|other| &other.value);
        let mut limited = known.chain(tracked).fold(self.memory.left, |most, from| {
            let away = apart(&asked.value, from);
            core::array::from_fn(|i| most[i].max(away[i]))
        });
        limited[2] = 0.0;
        limited
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
mod tests;
