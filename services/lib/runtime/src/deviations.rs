//! What a step's inputs lacked, published beside its outputs.
//!
//! What a step should have seen follows from edges and time, so only the exceptions are reported:
//! with them a recording determines every step, also of a realtime flight.

use crate::input::left_out::LateRange;
use crate::input::{Input, InputVisitor, Newest};
use crate::output::Output;
use crate::state_header::StateHeader;
use core::convert::Infallible;
use shared_types::{Deviation, DeviationKind, Header, Role, SEATS, Sample, Seat, Topic, topics};

/// Inputs of one loop that are waited for; no loop has more.
const MAX_AWAITED: usize = 8;

/// Roles, and seats of a role, that a number can distinguish.
const RADIX: (u32, u32) = (8, 4);
const _: () = assert!(Role::STEPPING.len() < RADIX.0 as usize && SEATS <= RADIX.1 as usize);

/// Identifies a loop on topics that all loops write: role and seat.
pub(crate) fn loop_number(seat: Seat) -> u32 {
    seat.index.wrapping_mul(RADIX.0).wrapping_add(seat.role.0)
}

/// Identifies one life of a process on topics that all processes write: role, seat and generation.
/// Each life counts for itself, so that a successor's numbers are not taken for repetitions.
#[must_use]
pub fn life_number(seat: Seat, generation: u32) -> u32 {
    generation.wrapping_mul(RADIX.0 * RADIX.1).wrapping_add(loop_number(seat))
}

/// Seat that a number of either kind contains.
#[must_use]
pub fn seat_of_loop(number: u32) -> u32 {
    number / RADIX.0 % RADIX.1
}

/// Writes deviations of one step.
pub(crate) struct Report<'a> {
    output: &'a mut Output<Deviation>,
    header: Header,
    role: Role,
}

impl<'a> Report<'a> {
    /// `step` is the header of what the step sends.
    pub(crate) fn new(output: &'a mut Output<Deviation>, step: &Header, role: Role) -> Self {
        let seat = life_number(Seat { role, index: step.seat }, step.generation);
        Self { output, header: Header { seat, ..*step }, role }
    }

    fn write(&mut self, kind: DeviationKind, input: &str, deviation: Deviation) {
        let input = Deviation::input_from(input);
        self.output.write(Deviation { kind, input, role: self.role, ..deviation });
        self.output.flush(&self.header);
    }

    /// Reports samples before `header`'s that the loop did not receive, if there are any.
    /// `counts_again`: the seat did not count for some of the time.
    fn lost(
        &mut self,
        input: &str,
        header: &Header,
        missing: u64,
        counts_again: bool,
        generation: u32,
    ) {
        if missing > 0 {
            let lost = Deviation {
                first: header.sequence - missing,
                last: header.sequence - 1,
                due_ns: if counts_again { header.valid_ns } else { 0 },
                writer_seat: header.seat,
                writer_generation: generation,
                ..Deviation::default()
            };
            self.write(DeviationKind::LostSamples, input, lost);
        }
    }

    /// Reports the last sample that the loop received from a writer.
    fn ended(&mut self, input: &str, writer: (u32, u32), last: &Newest) {
        self.sample(DeviationKind::Ended, input, writer, last.sequence);
    }

    /// The writers from which the loop had a sample before its first step, and which of them had gone when it began.
    fn known<T: Sample>(&mut self, name: &str, input: &Input<T>) {
        for (index, known) in input.newest_before().into_iter().enumerate() {
            let (Some(known), Ok(seat)) = (known, u32::try_from(index)) else { continue };
            let generation = if input.counts_anew() { known.generation } else { 0 };
            self.began(name, (seat, generation), 0);
            // Elsewhere a restarted process goes on with the numbers of the one before.
            if input.counts_anew() && input.has_gone(index, known.generation) {
                self.ended(name, (seat, generation), &known);
            }
        }
    }

    /// Reports the first sample that the loop received from a writer; 0 if it had some before its first step.
    fn began(&mut self, input: &str, writer: (u32, u32), first: u64) {
        self.sample(DeviationKind::Began, input, writer, first);
    }

    fn sample(
        &mut self,
        kind: DeviationKind,
        input: &str,
        (writer_seat, writer_generation): (u32, u32),
        sequence: u64,
    ) {
        let (first, last) = (sequence, sequence);
        let deviation =
            Deviation { first, last, writer_seat, writer_generation, ..Deviation::default() };
        self.write(kind, input, deviation);
    }

    /// Reports samples that came after their step.
    fn late(&mut self, input: &str, writer_seat: u32, late: &LateRange) {
        let LateRange { generation: writer_generation, first, last, due_ns } = *late;
        let default = Deviation::default();
        let late = Deviation { first, last, due_ns, writer_seat, writer_generation, ..default };
        self.write(DeviationKind::LateSamples, input, late);
    }

    fn range(&mut self, kind: DeviationKind, input: &str, first: u64, last: u64) {
        self.write(kind, input, Deviation { first, last, ..Deviation::default() });
    }
}

/// What happened to the loop since its last step.
#[derive(Debug, Default)]
pub(crate) struct Pending {
    /// Topics that were not final at a deadline.
    missed: [Option<&'static str>; MAX_AWAITED],
    /// Deadlines missed.
    misses: u64,
    /// First release left out.
    pub(crate) skipped_from: Option<u64>,
    /// Times a release was run late.
    pub(crate) caught_up: u64,
    /// Release of the state that the process went on from.
    pub(crate) resumed: Option<u64>,
}

impl Pending {
    /// Notes a deadline and the topics that are not waited for any longer.
    pub(crate) fn missed(&mut self, names: impl Iterator<Item = &'static str>) {
        self.misses += 1;
        self.name_missed(names);
    }

    fn name_missed(&mut self, names: impl Iterator<Item = &'static str>) {
        for name in names {
            let known = |slot: &&mut Option<&str>| slot.is_none_or(|other| other == name);
            if let Some(slot) = self.missed.iter_mut().find(known) {
                *slot = Some(name);
            }
        }
    }

    /// Takes in what an earlier run of the same step has published; gives the releases left out.
    pub(crate) fn repeat(&mut self, deviation: &Deviation, counts: &mut StateHeader) -> u64 {
        match deviation.kind {
            DeviationKind::MissedDeadline => {
                // A deadline may be missed on several inputs; each record has the number of all.
                let before = core::mem::replace(&mut self.misses, deviation.first);
                counts.input_deadline_misses += deviation.first.saturating_sub(before);
                let known = topics::all().into_iter().find(|t| t.name == deviation.input_name());
                self.name_missed(known.map(|topic| topic.name).into_iter());
            }
            DeviationKind::SkippedReleases => {
                let count = deviation.last.saturating_sub(deviation.first).saturating_add(1);
                counts.skipped = counts.skipped.saturating_add(count);
                self.skipped_from.get_or_insert(deviation.first);
                return count;
            }
            DeviationKind::CaughtUp => {
                counts.caught_up = counts.caught_up.saturating_add(deviation.first);
                self.caught_up = self.caught_up.saturating_add(deviation.first);
            }
            _ => {}
        }
        0
    }

    /// Publishes and forgets; `index` is the release that runs next.
    pub(crate) fn publish(&mut self, report: &mut Report<'_>, index: u64) {
        if let Some(release) = self.resumed.take() {
            report.range(DeviationKind::Resumed, "", release, release);
        }
        let misses = core::mem::take(&mut self.misses);
        for name in self.missed.iter_mut().map_while(Option::take) {
            report.range(DeviationKind::MissedDeadline, name, misses, misses);
        }
        if let Some(first) = self.skipped_from.take() {
            report.range(DeviationKind::SkippedReleases, "", first, index.saturating_sub(1));
        }
        if self.caught_up > 0 {
            let count = core::mem::take(&mut self.caught_up);
            report.range(DeviationKind::CaughtUp, "", count, count);
        }
    }
}

/// Looks at what the inputs have just accepted.
pub(crate) struct ReportInputs<'a> {
    pub(crate) report: Report<'a>,
    /// Instant of the step before, from which lateness is judged.
    pub(crate) previous_ns: Option<u64>,
    /// The process goes on from a state, or has joined in flight.
    pub(crate) in_flight: bool,
    /// This is its first step since.
    pub(crate) begins: bool,
}

impl InputVisitor for ReportInputs<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let name = topic.info.name;
        let (mut newest, mut ignored) = (input.newest_before(), input.ignored_before());
        let mut late: [Option<LateRange>; SEATS] = [None; SEATS];
        let counts_anew = input.counts_anew();
        if self.begins {
            self.report.known(name, input);
        }
        for sample in input.fresh() {
            let header = sample.header();
            let seat = usize::try_from(header.seat).unwrap_or(SEATS);
            let (Some(newest), Some(late)) = (newest.get_mut(seat), late.get_mut(seat)) else {
                continue;
            };
            let generation = input.generation_of(header);
            let writer = (header.seat, generation);
            let missing = match newest.replace(Newest::of(header)) {
                Some(before) => {
                    if counts_anew && before.generation != header.generation {
                        // The last samples of a killed process may have reached others, and its
                        // successor repeats their numbers. A process that had gone when this one
                        // began has been reported.
                        if !input.has_gone(seat, before.generation) {
                            self.report.ended(name, (header.seat, before.generation), &before);
                        }
                        self.report.began(name, writer, header.sequence);
                    }
                    before.missing_before(header, counts_anew)
                }
                // The first writer of all counts from 1, one that comes in flight from anywhere.
                None if header.seat == 0 && header.generation == 0 && !input.joined() => {
                    header.sequence.saturating_sub(1)
                }
                None => {
                    if self.in_flight {
                        self.report.began(name, writer, header.sequence);
                    }
                    0
                }
            };
            let counts_again = ignored.get_mut(seat).is_some_and(core::mem::take);
            self.report.lost(name, header, missing, counts_again, generation);
            if self.previous_ns.is_some_and(|p| input.in_effect(header.valid_ns, p)) {
                // Numbers are each writer's own: a range never spans two of them.
                if let Some(before) = late.take_if(|late| late.generation != generation) {
                    self.report.late(name, header.seat, &before);
                }
                let (sequence, due_ns) = (header.sequence, input.effect_ns(header.valid_ns));
                let new = LateRange { generation, first: sequence, last: sequence, due_ns };
                late.get_or_insert(new).last = sequence;
            }
        }
        for ranges in [late, input.left_out()] {
            for (seat, range) in (0..).zip(ranges) {
                if let Some(range) = range {
                    self.report.late(name, seat, &range);
                }
            }
        }
        Ok(())
    }
}

/// Reports how far the inputs have got.
pub(crate) struct ReportEnd<'a>(pub(crate) Report<'a>);

impl InputVisitor for ReportEnd<'_> {
    type Error = Infallible;
    fn visit<T: Sample>(
        &mut self,
        topic: &'static Topic<T>,
        input: &mut Input<T>,
    ) -> Result<(), Infallible> {
        let name = topic.info.name;
        let newest = input.newest();
        for (seat, last) in (0..).zip(&newest) {
            if let Some(last) = last {
                let generation = if input.counts_anew() { last.generation } else { 0 };
                self.0.ended(name, (seat, generation), last);
            }
        }
        if newest.iter().all(Option::is_none) {
            self.0.range(DeviationKind::Ended, name, 0, 0);
        }
        Ok(())
    }
}
