"""One input of a loop: what has arrived, what is in effect, what is new."""

import bisect
import collections
import math
import struct
import typing

# Samples that may wait for their instant.
CAPACITY = 1024
# Of a header: sequence, release_ns, valid_ns, seat and generation.
HEADER = struct.Struct("<QQQ48xII")


class Sample(typing.NamedTuple):
    """A sample as it lies in memory, in the order in which samples take effect."""

    valid_ns: int
    seat: int
    sequence: int
    generation: int
    received_mono_ns: int
    packed: bytes
    release_ns: int = 0


class Stamps:
    """What each process on a slot's seats has stamped.

    A sample that names an earlier step than the one it was made at is none that a reader has waited for: chance would
    decide at which step it arrives. A process that sends one is not followed any longer.
    """

    def __init__(self, latency_ns, is_asap):
        self._latency_ns = latency_ns
        self._is_asap = is_asap
        # By seat: generation, sequence and release of the newest sample, and the number from which on none is followed.
        self._known = {}

    def follow(self, sample):
        """True if a process has kept to its steps up to this sample: none of its samples names an earlier step than
        the one before, and each takes effect the latency of its topic after it."""
        is_due = self._is_asap or sample.valid_ns == sample.release_ns + self._latency_ns
        known = self._known.get(sample.seat)
        if known is None or known[0] < sample.generation:
            known = (sample.generation, sample.sequence, sample.release_ns, math.inf)
        generation, sequence, release_ns, broken_from = known
        # What its predecessor wrote before it went may arrive later.
        if generation > sample.generation:
            return is_due
        # Samples may change places on their way.
        is_newest = sample.sequence >= sequence
        if not is_due or (is_newest and sample.release_ns < release_ns):
            broken_from = min(broken_from, sample.sequence)
        elif is_newest:
            sequence, release_ns = sample.sequence, sample.release_ns
        self._known[sample.seat] = (generation, sequence, release_ns, broken_from)
        return sample.sequence < broken_from


class Input:
    """The samples of one topic, each taken in at the step from which on it is in effect."""

    def __init__(self, sample_type, receive, producer, is_awaited):
        self.type = sample_type
        self.producer = producer
        self.is_awaited = is_awaited
        self._receive = receive
        self._pending = []
        # By seat, the newest sample in effect.
        self._newest = {}
        self._known_until_ns = None
        # Owner records of the producer's slot: what an owner does not publish, no loop waits for.
        self.book = None
        # Of a slot: what its processes state about when they wrote.
        self.stamps = None
        self.late = self.lost = 0
        self._unheard = set()
        self.latest = self.before = None
        self.fresh = []
        self._value = None

    def receive(self):
        """Takes in all that has arrived."""
        for received_mono_ns, packed in self._receive():
            sequence, release_ns, valid_ns, seat, generation = HEADER.unpack_from(packed)
            sample = Sample(
                valid_ns, seat, sequence, generation, received_mono_ns, packed, release_ns
            )
            if self.stamps is None or self.stamps.follow(sample):
                self.arrive(sample)

    def arrive(self, sample):
        """Takes one sample in, in the order of effect, seat and sequence. One that comes again, as
        history or from a restarted process, is ignored or replaces the one that is still pending."""
        newest = self._newest.get(sample.seat)
        if newest is not None:
            # What a seat publishes after that is new, however late it arrives.
            if (sample.valid_ns, sample.sequence) <= (newest.valid_ns, newest.sequence):
                return
        elif self._known_until_ns is not None and sample.valid_ns <= self._known_until_ns:
            return
        pending, key = self._pending, sample[:3]
        if not pending or pending[-1][:3] < key:
            pending.append(sample)
            self._make_room()
            return
        at = bisect.bisect_left(pending, key)
        if at < len(pending) and pending[at][:3] == key:
            pending[at] = sample
        else:
            pending.insert(at, sample)
            self._make_room()

    def _make_room(self):
        """Leaves out the oldest sample of the seat that has most, where too many wait, so that no writer keeps another one's
        out."""
        if len(self._pending) <= CAPACITY:
            return
        waiting = collections.Counter(sample.seat for sample in self._pending)
        most = max(waiting, key=waiting.get)
        oldest = next(i for i, sample in enumerate(self._pending) if sample.seat == most)
        del self._pending[oldest]

    def accept(self, t_ns, previous_ns):
        """Puts into effect what is due at `t_ns` and nothing later; what was due at the step before
        is counted as late."""
        self.before, self.fresh = self.latest, []
        count = 0
        for sample in self._pending:
            if sample.valid_ns > t_ns:
                break
            count += 1
            if self.book is None or self.book.counts(sample.seat, sample.valid_ns):
                self._take(sample, previous_ns)
        if count:
            del self._pending[:count]
        # What a seat publishes while it does not count is not missing afterwards.
        if self.book is not None:
            self._unheard |= {seat for seat in self._newest if not self.book.counts(seat, t_ns)}

    def _take(self, sample, previous_ns):
        if previous_ns is not None and sample.valid_ns <= previous_ns:
            self.late += 1
        before = self._newest.get(sample.seat)
        was_ignored = sample.seat in self._unheard
        self._unheard.discard(sample.seat)
        if before and before.generation == sample.generation and not was_ignored:
            self.lost += max(0, sample.sequence - before.sequence - 1)
        self._newest[sample.seat] = self.latest = sample
        self._value = None
        self.fresh.append(sample)

    def skip_until(self, t_ns):
        """Lets what is in effect at `t_ns` be known without being new: a loop that joins a flight
        begins with the samples of its first period."""
        self.accept(t_ns, None)
        self.before, self.fresh = self.latest, []
        self.late = self.lost = 0
        self._known_until_ns = t_ns

    def value_of(self, sample):
        """A sample's fields."""
        return self.type.from_buffer_copy(sample.packed)

    @property
    def value(self):
        """The fields of the latest sample in effect; None before the first."""
        if self._value is None and self.latest is not None:
            self._value = self.value_of(self.latest)
        return self._value
