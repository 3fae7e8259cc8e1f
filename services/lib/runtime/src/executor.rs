//! Runs the releases of one component, one after the other, and publishes all it owes.

use crate::component::Component;
use crate::deviations::{Pending, Report, ReportEnd, ReportInputs, loop_number};
use crate::graph::{Edge, MissPolicy, Node};
use crate::output::Output;
use crate::service::RestoreError;
use crate::state_header::StateHeader;
use crate::upkeep::Costs;
use shared_types::{Deviation, Handover, Header, LoopStats, Seat};

/// Logical time between two [`LoopStats`] \[ns\].
const STATS_PERIOD_NS: u64 = 100_000_000;

/// Releases left out in a row over which the change since the last step is still about the last period.
const LEFT_OUT_MAX: u64 = 1;

/// Where packed states go.
pub trait StateSink {
    /// False for a state that no reader needs, which then is not packed.
    fn wants(&self, _header: &Header) -> bool {
        true
    }
    /// Publishes a state; must not block.
    fn send(&mut self, header: &Header, state: &[u8]);
    /// Lets a reader that has just joined have the last state.
    fn serve_late_joiners(&mut self);
}

/// Host instants of one step.
#[derive(Debug, Clone, Copy)]
pub struct StepStamps {
    /// Intended release on the host clock \[ns\].
    pub release_mono_ns: u64,
    /// When the step began \[ns\].
    pub start_mono_ns: u64,
    /// Reads the host clock; only stamps come from it.
    pub now_mono_ns: fn() -> u64,
}

impl StepStamps {
    /// Of a step whose times nothing asks for.
    pub const UNTIMED: Self = Self { release_mono_ns: 0, start_mono_ns: 0, now_mono_ns: || 0 };

    /// Of a step that is due as soon as it may run.
    #[must_use]
    pub fn at_once(now_mono_ns: fn() -> u64) -> Self {
        let start_mono_ns = now_mono_ns();
        Self { release_mono_ns: start_mono_ns, start_mono_ns, now_mono_ns }
    }
}

/// A step that has been computed and not published.
#[derive(Debug, Clone, Copy)]
pub struct Computed(Header);

impl Computed {
    /// Its release \[ns\].
    #[must_use]
    pub fn release_ns(&self) -> u64 {
        self.0.release_ns
    }
}

/// Which of its role's seats a component takes, and with which generation.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Place {
    /// Seat of the role.
    pub seat: u32,
    /// How many processes have had the seat before.
    pub generation: u32,
}

/// One component with its ports, at a place in its release grid.
pub struct Executor {
    /// The service, whose ports the transport connects.
    pub component: Component,
    node: Node,
    place: Place,
    /// Loop statistics; connected by the transport.
    pub stats: Output<LoopStats>,
    /// What the steps' inputs lacked; connected by the transport.
    pub deviations: Output<Deviation>,
    pending: Pending,
    state_sink: Option<Box<dyn StateSink>>,
    state_sequence: u64,
    state: Vec<u8>,
    next_index: u64,
    /// Instant of the next release, which is asked for all the time \[ns\].
    mark_ns: u64,
    previous_ns: Option<u64>,
    counts: StateHeader,
    /// Late and lost samples of the steps before a restored state.
    before: (u64, u64),
    rescued_waits: u64,
    /// What steady stretches cost, and those in which a process came or went.
    costs: [Costs; 2],
    /// Until then the component follows what its slot applies \[ns\].
    track_until_ns: u64,
    /// The release before the first of a component that joins a flight \[ns\].
    joins_after_ns: Option<u64>,
    /// The process went on from a state, or joined in flight.
    in_flight: bool,
    /// The next step is the first since then.
    begins: bool,
    /// Runs every past release until the first that is in time, whatever the policy.
    catching_up: bool,
}

impl core::fmt::Debug for Executor {
    fn fmt(&self, f: &mut core::fmt::Formatter<'_>) -> core::fmt::Result {
        f.debug_struct("Executor")
            .field("node", &self.node)
            .field("next_index", &self.next_index)
            .finish_non_exhaustive()
    }
}

impl Executor {
    /// A component at the start of its grid.
    #[must_use]
    pub fn new(component: Component, node: Node, place: Place) -> Self {
        let layout = component.layout();
        let (layout_hash, state) = (layout.hash(), vec![0; layout.state_size()]);
        Self {
            component,
            node,
            place,
            stats: Output::default(),
            deviations: Output::default(),
            pending: Pending::default(),
            state_sink: None,
            state_sequence: 0,
            state,
            next_index: 0,
            mark_ns: node.rate.release_ns(0),
            previous_ns: None,
            counts: StateHeader { layout_hash, ..StateHeader::default() },
            before: (0, 0),
            rescued_waits: 0,
            costs: [Costs::default(); 2],
            track_until_ns: 0,
            joins_after_ns: None,
            in_flight: false,
            begins: false,
            catching_up: false,
        }
    }

    /// Connects the state topic.
    pub fn connect_state(&mut self, sink: Box<dyn StateSink>) {
        self.state_sink = Some(sink);
    }

    /// The loop this executor runs.
    #[must_use]
    pub fn node(&self) -> &Node {
        &self.node
    }

    /// The seat it takes, and its generation there.
    #[must_use]
    pub fn place(&self) -> Place {
        self.place
    }

    /// Instant of the next release: everything before it is final \[ns\].
    #[must_use]
    pub fn mark_ns(&self) -> u64 {
        self.mark_ns
    }

    /// See [`Service::quiet_until_ns`](crate::Service::quiet_until_ns), from the next release on.
    #[must_use]
    pub fn quiet_until_ns(&self, known_ns: u64) -> u64 {
        self.component.quiet_until_ns(self.mark_ns, known_ns)
    }

    /// Instant of the last release that has run; none before the first \[ns\].
    #[must_use]
    pub fn previous_ns(&self) -> Option<u64> {
        self.previous_ns
    }

    /// Steps run so far.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.counts.steps
    }

    /// Continues from a published state, at the release after it.
    ///
    /// # Errors
    /// [`RestoreError`] if the state is not one of this build's.
    pub fn restore(&mut self, state: &[u8]) -> Result<(), RestoreError> {
        let header = self.component.parts().unpack(state)?;
        let next_index = header.release_index.checked_add(1);
        self.go_to(
            next_index.ok_or_else(|| RestoreError::Refused("its release is the last".into()))?,
        );
        self.component.parts().knows_until(header.release_ns);
        self.pending.resumed = Some(header.release_index);
        (self.in_flight, self.begins) = (true, true);
        self.previous_ns = Some(header.release_ns);
        self.state_sequence = header.state_sequence;
        self.stats.resume_after(header.stats_sequence);
        self.before = (header.late_samples, header.lost_samples);
        self.counts = header;
        Ok(())
    }

    /// Takes a flight up from a published state: as [`restore`](Self::restore), but within one life of
    /// the process, so that nothing reports a restart.
    ///
    /// # Errors
    /// [`RestoreError`] if the state is not one of this build's.
    pub fn take_up(&mut self, state: &[u8]) -> Result<(), RestoreError> {
        self.restore(state)?;
        self.pending.resumed = None;
        (self.in_flight, self.begins) = (false, false);
        self.deviations.resume_after(self.counts.deviation_sequence);
        Ok(())
    }

    /// Continues at the first release at or after `t_ns`, whatever grid the state came from.
    pub fn continue_at(&mut self, t_ns: u64) {
        self.go_to(self.node.rate.first_at_or_after(t_ns));
    }

    /// Joins a flight at the first release at or after `t_ns`: without a state of its own the component
    /// knows what is in effect by then and follows its slot until `track_until_ns`. Its totals begin at
    /// zero: what the writer of its state missed was missed by another process.
    pub fn join_at(&mut self, t_ns: u64, track_until_ns: u64) {
        self.before = (0, 0);
        (self.in_flight, self.begins) = (true, true);
        let StateHeader { layout_hash, release_index, release_ns, .. } = self.counts;
        self.counts =
            StateHeader { layout_hash, release_index, release_ns, ..StateHeader::default() };
        let index = self.node.rate.first_at_or_after(t_ns);
        if self.previous_ns.is_some() {
            self.leave_out_until(index);
        } else {
            self.go_to(index);
            self.joins_after_ns = index.checked_sub(1).map(|k| self.node.rate.release_ns(k));
        }
        self.track_until_ns = track_until_ns;
    }

    /// Begins where a hand-over states, from a state if it contains one.
    ///
    /// # Errors
    /// [`RestoreError`] if the state is not one of this build's.
    pub fn begin(&mut self, order: &Handover, state: &[u8]) -> Result<(), RestoreError> {
        if order.has_state.is_set() {
            self.restore(state)?;
        }
        self.take_from(&order.first_generations);
        if order.catches_up.is_set() {
            self.catch_up();
        }
        if order.join_ns > 0 {
            self.join_at(order.join_ns, order.track_until_ns);
        }
        Ok(())
    }

    /// Leaves out samples of processes that had gone when this one began, see [`Handover::first_generations`].
    pub fn take_from(&mut self, first_generations: &[u32; Seat::COUNT]) {
        self.component.parts().take_from(first_generations);
    }

    /// Lets a component that shadows begin behind time and run what it has missed.
    pub fn catch_up(&mut self) {
        self.catching_up = true;
    }

    /// See [`Service::reseed`](crate::Service::reseed).
    pub fn reseed(&mut self, seed: u64) {
        self.component.parts().reseed(seed);
    }

    /// The whole evolving state after the last release of this process, as a keyframe of it would be;
    /// none before the first, and none from which no process could go on.
    pub fn state(&mut self) -> Option<&[u8]> {
        self.previous_ns.filter(|_| !self.begins)?;
        self.packed_state(self.state_sequence)
    }

    /// None if the memory is not finite.
    fn packed_state(&mut self, sequence: u64) -> Option<&[u8]> {
        self.counts.state_sequence = sequence;
        self.counts.stats_sequence = self.stats.sequence();
        self.counts.deviation_sequence = self.deviations.sequence();
        self.component.pack(&self.counts, &mut self.state);
        Some(self.state.as_slice()).filter(|state| self.component.layout().is_finite(state))
    }

    /// Brings the counts of what the inputs lacked up to date.
    fn count_samples(&mut self) {
        let inputs = self.component.counts();
        self.counts.late_samples = self.before.0.saturating_add(inputs.late);
        self.counts.lost_samples = self.before.1.saturating_add(inputs.lost);
    }

    /// Runs the next release: accept, step, publish outputs, then state and statistics.
    pub fn run_step(&mut self, stamps: StepStamps) {
        let computed = self.compute(stamps.release_mono_ns, stamps.start_mono_ns);
        self.publish(computed, (stamps.now_mono_ns)());
    }

    /// The first half of a step, which has taken in what is in effect and computed; what it has written waits.
    #[must_use]
    pub fn compute(&mut self, release_mono_ns: u64, start_mono_ns: u64) -> Computed {
        let now_ns = self.mark_ns();
        if let Some(before_ns) = self.joins_after_ns.take() {
            self.component.parts().skip_until(before_ns);
            self.previous_ns = Some(before_ns);
        }
        let left_out =
            self.pending.skipped_from.map_or(0, |from| self.next_index.saturating_sub(from));
        if left_out > LEFT_OUT_MAX {
            self.component.parts().skip(left_out);
        }
        let tracks = now_ns < self.track_until_ns;
        let (origin, cause) = self.component.parts().step(now_ns, self.previous_ns, tracks);
        Computed(Header {
            input_sequence: origin.sequence,
            receive_mono_ns: origin.receive_mono_ns,
            release_mono_ns,
            start_mono_ns,
            ..self.header(now_ns, cause)
        })
    }

    /// The second half: publishes all that it owes at an instant of the host clock \[ns\], and goes on to the next release.
    pub fn publish(&mut self, Computed(header): Computed, publish_mono_ns: u64) {
        let (header, now_ns) = (Header { publish_mono_ns, ..header }, header.release_ns);
        self.component.parts().flush(&header);
        self.counts.steps += 1;
        self.counts.release_index = self.next_index;
        self.counts.release_ns = now_ns;
        self.count_samples();
        self.publish_deviations(&header);
        self.publish_stats(&header);
        self.publish_state(&header);
        self.previous_ns = Some(now_ns);
        self.go_to(self.next_index + 1);
    }

    /// Header of everything that one step sends.
    fn header(&self, release_ns: u64, cause_sequence: u64) -> Header {
        let Place { seat, generation } = self.place;
        Header { release_ns, cause_sequence, seat, generation, ..Header::default() }
    }

    fn go_to(&mut self, index: u64) {
        self.next_index = index;
        self.mark_ns = self.node.rate.release_ns(index);
    }

    /// Leaves out releases up to the last one at or before `t_ns`, keeping that one.
    pub fn skip_to(&mut self, t_ns: u64) {
        let newest = self.node.rate.first_at_or_after(t_ns.saturating_add(1)).saturating_sub(1);
        self.leave_out_until(newest);
    }

    /// Leaves out every release at or before `t_ns`.
    pub fn skip_past(&mut self, t_ns: u64) {
        self.leave_out_until(self.node.rate.first_at_or_after(t_ns.saturating_add(1)));
    }

    fn leave_out_until(&mut self, index: u64) {
        if index > self.next_index {
            self.counts.skipped += index - self.next_index;
            self.pending.skipped_from.get_or_insert(self.next_index);
            self.go_to(index);
        }
    }

    /// Decides about releases that lie in the past at logical time `now_ns`, by the loop's miss
    /// policy. A source that works ahead is never late.
    pub fn apply_miss_policy(&mut self, now_ns: u64) {
        let following_ns = self.node.rate.release_ns(self.next_index + 1);
        if self.node.lead_ns > 0 || now_ns < following_ns {
            self.catching_up = false;
            return;
        }
        if self.catching_up {
            return;
        }
        match self.node.miss_policy {
            MissPolicy::CatchUp => {
                self.counts.caught_up += 1;
                self.pending.caught_up += 1;
            }
            MissPolicy::Skip => self.skip_to(now_ns),
            MissPolicy::Hold => self.skip_past(now_ns),
        }
    }

    /// Counts a step that starts although these of its inputs are not final.
    pub fn count_input_deadline_miss<'a>(&mut self, awaited: impl Iterator<Item = &'a Edge>) {
        self.counts.input_deadline_misses += 1;
        self.pending.missed(awaited.map(|edge| edge.topic.name));
    }

    /// Repeats what a recorded deviation reports about the loop as a whole: releases left out or caught
    /// up, deadlines missed. The other kinds are about samples, which the transport withholds.
    pub fn repeat(&mut self, deviation: &Deviation) {
        let left_out = self.pending.repeat(deviation, &mut self.counts);
        self.go_to(self.next_index + left_out);
    }

    /// Counts a wait that only its wall-clock limit ended.
    pub fn count_rescued_wait(&mut self) {
        self.rescued_waits += 1;
    }

    /// Notes what the loop has cost so far, to be published with its statistics.
    pub(crate) fn note_costs(&mut self, steady: Costs, at_changes: Costs) {
        self.costs = [steady, at_changes];
    }

    /// Lets readers that have just joined have the history of every output.
    pub fn serve_late_joiners(&mut self) {
        self.component.parts().serve_late_joiners();
        self.stats.serve_late_joiners();
        self.deviations.serve_late_joiners();
        if let Some(sink) = &mut self.state_sink {
            sink.serve_late_joiners();
        }
    }

    /// Publishes the totals of the whole flight.
    pub fn finish(&mut self) {
        let header = self.header(self.mark_ns(), 0);
        let mut report = Report::new(&mut self.deviations, &header, self.node.role);
        self.pending.publish(&mut report, self.next_index);
        self.component.parts().report_end(&mut ReportEnd(report));
        self.count_samples();
        let release_ns = self.previous_ns.unwrap_or(0);
        self.send_stats(&self.header(release_ns, 0));
    }

    fn publish_deviations(&mut self, header: &Header) {
        let mut report = Report::new(&mut self.deviations, header, self.node.role);
        self.pending.publish(&mut report, self.next_index);
        let (in_flight, begins) = (self.in_flight, core::mem::take(&mut self.begins));
        let mut inputs = ReportInputs { report, previous_ns: self.previous_ns, in_flight, begins };
        self.component.parts().report(&mut inputs);
    }

    fn publish_stats(&mut self, header: &Header) {
        let due = |t_ns: u64| t_ns / STATS_PERIOD_NS;
        if self.previous_ns.is_none_or(|p| due(p) != due(header.release_ns)) {
            self.send_stats(header);
        }
    }

    fn send_stats(&mut self, header: &Header) {
        let [steady, at_changes] = self.costs;
        self.stats.write(LoopStats {
            steps: self.counts.steps,
            skipped: self.counts.skipped,
            caught_up: self.counts.caught_up,
            input_deadline_misses: self.counts.input_deadline_misses,
            late_samples: self.counts.late_samples,
            lost_samples: self.counts.lost_samples,
            rescued_waits: self.rescued_waits,
            generation: u64::from(self.place.generation),
            allocations: steady.allocations,
            transport_allocations: steady.transport_allocations,
            minor_faults: steady.minor_faults,
            major_faults: steady.major_faults,
            allocations_at_changes: at_changes.allocations,
            faults_at_changes: at_changes.minor_faults + at_changes.major_faults,
            role: self.node.role,
            ..LoopStats::default()
        });
        let seat = Seat { role: self.node.role, index: self.place.seat };
        self.stats.flush(&Header { seat: loop_number(seat), ..*header });
    }

    fn publish_state(&mut self, header: &Header) {
        if !self.next_index.is_multiple_of(self.component.state_every()) {
            return;
        }
        // Numbered whether it is sent or not: the content of a state does not depend on its readers.
        self.state_sequence += 1;
        let sequence = self.state_sequence;
        let header = Header { sequence, valid_ns: header.release_ns, ..*header };
        let is_wanted = self.state_sink.as_ref().is_some_and(|sink| sink.wants(&header));
        // Where it is not finite, the last one that a process can go on from stays the last one.
        if !is_wanted || self.packed_state(sequence).is_none() {
            return;
        }
        if let Some(sink) = &mut self.state_sink {
            sink.send(&header, &self.state);
        }
    }
}
