"""Release grids, and which loop waits for which: the arrows of `flight.toml` as one process sees them."""

import typing


class Rate:
    """Release k of a loop is at floor(k * 10^9 / rate) ns of logical time, in integers."""

    def __init__(self, rate_hz):
        self.millihertz = round(rate_hz * 1000)
        self.period_ns = -(-(10**12) // self.millihertz)

    @property
    def hz(self):
        return self.millihertz / 1000

    def instant(self, index):
        """Instant of a release [ns]."""
        return index * 10**12 // self.millihertz

    def first_at_or_after(self, t_ns):
        """Index of the first release at or after an instant."""
        index = t_ns * self.millihertz // 10**12
        return index if self.instant(index) >= t_ns else index + 1


class Edge(typing.NamedTuple):
    """One arrow of the data flow, as the launcher declares it."""

    topic: str
    producer: str
    consumer: str
    latency_ns: int
    deadline_ns: int
    strict: bool
    asap: bool

    def open_until_ns(self, mark_ns):
        """Steps of the consumer before this instant may run once the producer's mark is `mark_ns`."""
        return mark_ns + self.latency_ns + self.strict

    def unblocks(self, consumer, old_ns, new_ns):
        """True if moving the producer's mark may unblock a release of a consumer at this rate."""
        first = consumer.first_at_or_after(self.open_until_ns(old_ns))
        return consumer.instant(first) < self.open_until_ns(new_ns)


class Graph:
    """The loops of a flight, and the arrows to and from the loop of one role."""

    def __init__(self, flight, role):
        self.rates = {loop["role"]: Rate(loop["rate_hz"]) for loop in flight["loops"]}
        edges = [
            Edge(
                edge["topic"],
                edge["from"],
                edge["to"],
                edge["latency_ns"],
                edge["deadline_ns"],
                edge["strict"],
                edge["asap"],
            )
            for edge in flight["edges"]
        ]
        self.inputs = [edge for edge in edges if edge.consumer == role]
        self.outputs = [edge for edge in edges if edge.producer == role]
        # Roles that this one waits for, and roles that wait for it.
        self.producers = {edge.producer for edge in self.inputs}
        self.consumers = {edge.consumer for edge in self.outputs}

    def edge_of(self, topic):
        """The arrow that brings a topic here; None for owner records, which no loop waits for."""
        return next((edge for edge in self.inputs if edge.topic == topic), None)

    def latency_ns(self, topic):
        """Declared latency of an output; 0 if no loop reads it."""
        return next((edge.latency_ns for edge in self.outputs if edge.topic == topic), 0)

    def is_asap(self, topic):
        """True if, in realtime, an output takes effect when it is published."""
        return any(edge.asap for edge in self.outputs if edge.topic == topic)

    def open_until_ns(self, marks, allowed_ns):
        """Every release before this instant is permitted by all arrows and by the clock."""
        opened = (edge.open_until_ns(marks.of_edge(edge)) for edge in self.inputs)
        return min(allowed_ns, min(opened, default=allowed_ns))

    def missing_deadline_ns(self, marks, t_ns):
        """Realtime: the longest deadline of an input that is not final for the step at `t_ns`; 0 if
        the step has all that it waits for."""
        missing = (
            edge.deadline_ns
            for edge in self.inputs
            if edge.deadline_ns > 0 and t_ns >= edge.open_until_ns(marks.of_edge(edge))
        )
        return max(missing, default=0)

    def wakes(self, old_ns, new_ns):
        """Roles of which a release may be unblocked when this loop's mark moves. Between slots and
        their consumers no other mark implies this one, so all of them are worth waking."""
        return {
            edge.consumer
            for edge in self.outputs
            if edge.unblocks(self.rates[edge.consumer], old_ns, new_ns)
        }
