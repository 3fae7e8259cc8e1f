"""Runs the releases of one loop, one after the other, and publishes all it owes."""

from .inputs import Input, Stamps
from .ports import now_ns

STATS_PERIOD_NS = 100_000_000
# Slots, by the topic of their owner records.
OWNED = {"attitude_owner": "attitude", "position_owner": "position"}


class Output:
    """One output: at most one sample per step, stamped and sent by the loop."""

    def __init__(self, writer, sample_type, latency_ns, is_asap, release_ns=None):
        self.writer = writer
        self.value = sample_type()
        self.sequence = 0
        # Gives the release of the step that is being run.
        self._release_ns = release_ns
        self._latency_ns = latency_ns
        self._is_asap = is_asap

    def send(self, header, wall_ns):
        """Stamps and sends the value. `wall_ns` gives logical time by the wall clock.

        A sample belongs to the step in which it is sent: nothing waits for one of an earlier step.
        """
        self.sequence += 1
        value = self.value
        value.header = header
        if self._release_ns is not None:
            value.header.release_ns = self._release_ns()
        value.header.sequence = self.sequence
        value.header.valid_ns = value.header.release_ns + self._latency_ns
        if self._is_asap and wall_ns is not None:
            value.header.valid_ns = max(wall_ns(header.publish_mono_ns), value.header.release_ns)
        self.writer.send(value)


class Loop:
    """A control law's inputs, outputs and place in its release grid.

    `law.step(t_ns, loop)` fills in outputs and gives the names of those to send.
    """

    def __init__(self, bus, graph, marks, role, place, topics):
        inputs, outputs = topics
        samples = bus.samples
        self.role, self.place = role, place
        self.rate = graph.rates[role]
        self.inputs = {}
        for name in inputs:
            edge = graph.edge_of(name)
            producer = edge.producer if edge else samples.TOPICS[name].producer.name.lower()
            receive = bus.topic(name, producer).receive
            self.inputs[name] = Input(samples.TOPICS[name].type, receive, producer, edge is not None)
            if edge and samples.TOPICS[name].producer.name.lower() in OWNED.values():
                self.inputs[name].stamps = Stamps(edge.latency_ns, edge.asap)
        for slot in (OWNED[name] for name in inputs if name in OWNED):
            for taken in self.inputs.values():
                if taken.producer == slot:
                    taken.book = marks.book(slot)
        self.outputs = {
            name: Output(
                bus.writer(name, samples.TOPICS[name].type),
                samples.TOPICS[name].type,
                graph.latency_ns(name),
                graph.is_asap(name),
                lambda: self.mark_ns,
            )
            for name in outputs
        }
        self._stats = Output(bus.writer("loop_stats", samples.LoopStats), samples.LoopStats, 0, False)
        self._stats.value.role = samples.Role[role.capitalize()]
        self._stats.value.generation = place.generation
        self._header_type = samples.Header
        self.cause = self.inputs[inputs[0]]
        self.index = 0
        self.mark_ns = 0
        self.previous_ns = None
        self.track_until_ns = 0
        self.steps = self.skipped = self.missed = self.rescued = 0
        self._joins_after_ns = None
        # Realtime: the wall clock's map to logical time.
        self.wall_ns = None

    # Place in the grid.

    def go_to(self, index):
        self.index = index
        # Everything before the next release has been published.
        self.mark_ns = self.rate.instant(index)

    def join(self, t_ns, track_until_ns):
        """Joins a flight at the first release at or after an instant."""
        self.go_to(self.rate.first_at_or_after(t_ns))
        if self.index > 0:
            self._joins_after_ns = self.rate.instant(self.index - 1)
        self.track_until_ns = track_until_ns

    def skip_to(self, t_ns):
        """Leaves out releases up to the last one at or before an instant, keeping that one."""
        newest = self.rate.first_at_or_after(t_ns + 1) - 1
        if newest > self.index:
            self.skipped += newest - self.index
            self.go_to(newest)

    @property
    def is_tracking(self):
        """True if the coming step is a shadow's that follows what its slot applies."""
        return self.mark_ns < self.track_until_ns

    # Steps.

    def receive(self, moved):
        """Takes in what has arrived from the roles whose marks have moved, and owner records: what a
        mark does not cover yet permits no step."""
        for taken in self.inputs.values():
            if not taken.is_awaited or moved is None or taken.producer in moved:
                taken.receive()

    def run_step(self, law, start_mono_ns, release_mono_ns):
        """Runs the next release: inputs, law, outputs, statistics."""
        t_ns = self.mark_ns
        if self._joins_after_ns is not None:
            for taken in self.inputs.values():
                taken.skip_until(self._joins_after_ns)
            self.previous_ns, self._joins_after_ns = self._joins_after_ns, None
        for taken in self.inputs.values():
            taken.accept(t_ns, self.previous_ns)
        sent = law.step(t_ns, self)
        header = self._header(t_ns)
        cause = self.cause.value
        if cause is not None:
            header.cause_sequence = cause.header.cause_sequence
            header.input_sequence = cause.header.sequence
            header.receive_mono_ns = self.cause.latest.received_mono_ns
        header.release_mono_ns = release_mono_ns
        header.start_mono_ns = start_mono_ns
        header.publish_mono_ns = now_ns()
        for name in sent:
            self.outputs[name].send(header, self.wall_ns)
        self.steps += 1
        previous_ns, self.previous_ns = self.previous_ns, t_ns
        if previous_ns is None or previous_ns // STATS_PERIOD_NS != t_ns // STATS_PERIOD_NS:
            self._send_stats(header)
        self.go_to(self.index + 1)

    def _header(self, release_ns):
        return self._header_type(
            release_ns=release_ns, seat=self.place.seat, generation=self.place.generation
        )

    def finish(self):
        """Publishes the totals of the whole flight."""
        self._send_stats(self._header(self.previous_ns or 0))

    def _send_stats(self, header):
        stats = self._stats.value
        stats.steps, stats.skipped = self.steps, self.skipped
        stats.input_deadline_misses, stats.rescued_waits = self.missed, self.rescued
        stats.late_samples = sum(taken.late for taken in self.inputs.values())
        stats.lost_samples = sum(taken.lost for taken in self.inputs.values())
        own = self._header_type.from_buffer_copy(header)
        # Of all loops of a run this is the one of a role and a seat.
        own.seat = 8 * self.place.seat + stats.role
        self._stats.send(own, None)

    def serve_late_joiners(self):
        """Lets readers that have just joined have the history of every output."""
        for output in self.outputs.values():
            output.writer.serve_late_joiners()
        self._stats.writer.serve_late_joiners()
