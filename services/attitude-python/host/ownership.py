"""Which samples count: a slot's owner from instant to instant, and how far each process has got.

A slot's consumers wait for owner and fallback of each instant and never for a shadow. What takes effect
before a change comes from the old owner, what takes effect from then on from the new one.
"""

import typing

FOREVER = 2**64 - 1


class Tenure(typing.NamedTuple):
    """Which seats command a slot from an instant on."""

    from_ns: int
    epoch: int
    owner: int
    fallback: int
    periods_ns: tuple

    def may_command(self, seat):
        return seat in (self.owner, self.fallback)


class SlotBook:
    """The tenures of one slot: the one in effect and those announced."""

    def __init__(self):
        self.tenures = []

    def learn(self, record):
        """Takes in an owner record; one of a known epoch has no effect."""
        if self.tenures and record.epoch <= self.tenures[-1].epoch:
            return
        periods_ns = tuple(record.period_ns)
        self.tenures.append(
            Tenure(record.header.valid_ns, record.epoch, record.owner, record.fallback, periods_ns)
        )

    def forget_before(self, t_ns):
        """Forgets what ended before the step at `t_ns`, which has been run."""
        while len(self.tenures) > 1 and self.tenures[1].from_ns < t_ns:
            del self.tenures[0]

    def concerns(self, seat):
        """True if a seat may command, now or at an announced instant."""
        if not self.tenures:
            return seat == 0
        return any(tenure.may_command(seat) for tenure in self.tenures)

    def counts(self, seat, t_ns):
        """True if what a seat publishes for an instant can be followed, and was therefore waited for."""
        if not self.tenures:
            return True
        past = [tenure for tenure in self.tenures if tenure.from_ns <= t_ns]
        return (past[-1] if past else self.tenures[0]).may_command(seat)

    def released_ns(self, seat):
        """Instant from which a seat is taken no longer; FOREVER if none has been announced."""
        last = self.tenures[-1] if self.tenures else None
        return last.from_ns if last and not last.periods_ns[seat] else FOREVER

    def mark_ns(self, mark_of, latency_ns):
        """How far the slot as a whole has got, for an arrow of this latency."""
        if not self.tenures:
            return mark_of(0)
        begin_ns = 0
        following = [*self.tenures[1:], None]
        for tenure, after in zip(self.tenures, following):
            mark_ns = min(mark_of(tenure.owner), mark_of(tenure.fallback))
            end_ns = FOREVER if after is None else max(0, after.from_ns - latency_ns)
            if mark_ns < end_ns:
                return max(mark_ns, begin_ns)
            begin_ns = end_ns
        return FOREVER


class SeatMarks:
    """How far the process on every seat has got, and which seat owns which slot."""

    def __init__(self, seats):
        self._seats = seats
        # By role and seat: mark [ns], and generation of the process that reported it.
        self._known = {}
        self._books = {}

    def book(self, role):
        """The tenures of a role's slot."""
        return self._books.setdefault(role, SlotBook())

    def concerns(self, role, seat):
        """True if a consumer of the role may have to wait for a seat."""
        book = self._books.get(role)
        return seat == 0 if book is None else book.concerns(seat)

    def advance(self, role, seat, generation, mark_ns):
        """Takes in how far a process has got; a predecessor's last reports may come late."""
        mark_known_ns, known = self._known.get((role, seat), (0, -1))
        if known == generation:
            mark_ns = max(mark_ns, mark_known_ns)
        if known <= generation:
            self._known[role, seat] = (mark_ns, generation)

    def learn_registry(self, entries):
        """Takes in what is there: a process that has left is not waited for, and a successor begins anew."""
        for role, seat, generation, present, _period_ns in entries:
            known = self._known.get((role, seat), (0, -1))[1]
            if known < generation or (known == generation and not present):
                self._known[role, seat] = (0 if present else FOREVER, generation)

    def of_edge(self, edge):
        """How far the producer of an arrow has got [ns]."""
        book = self._books.get(edge.producer)
        mark_of = lambda seat: self._mark_ns(edge.producer, seat)  # noqa: E731
        return mark_of(0) if book is None else book.mark_ns(mark_of, edge.latency_ns)

    def _mark_ns(self, role, seat):
        if not 0 <= seat < self._seats:
            return FOREVER
        return self._known.get((role, seat), (0, None))[0]
