"""Which set point counts from instant to instant, at an attitude loop.

A set point is judged once, by the owner record in effect at its own effective instant. An instant once
decided stays decided: a record for it is refused, and its writer tries again further ahead. Once only
the fallback has a valid set point, it counts until the next epoch; after a trip until a record names
another owner or fallback.
"""

import math
import typing

from .backup import TILT_BOUND_RAD, backup_of, together

# Share of a bound by which a change to a controller of another kind may step at once, and the time over
# which the rest comes back [ns].
STEP_SHARE = 0.1
LIMITED_FOR_NS = 100_000_000
# Time constant with which the last set point fades [s].
FADES_S = 0.5


class Command(typing.NamedTuple):
    """A set point that was its writer's to give."""

    value: tuple  # Thrust [N], roll, pitch and yaw [rad].
    sequence: int
    seat: int
    valid_ns: int
    valid_until_ns: int

    def is_valid(self, t_ns):
        return self.valid_ns <= t_ns < self.valid_until_ns


class Record(typing.NamedTuple):
    """Which seats may command from an instant on."""

    epoch: int
    owner: int
    fallback: int
    effective_ns: int
    periods_ns: tuple
    kind_changed: bool
    watched: bool

    def is_taken(self, seat):
        return 0 <= seat < len(self.periods_ns) and self.periods_ns[seat] > 0

    def may_command(self, seat):
        return self.is_taken(seat) and seat in (self.owner, self.fallback)

    def hands(self):
        """Owner and fallback, each as far as a process sits there."""
        return [seat if self.is_taken(seat) else None for seat in (self.owner, self.fallback)]


class Limiter:
    """Takes the step out of a change to a controller of another kind, and lets it back in linearly."""

    def __init__(self, limits):
        self._limits = limits
        self.reset()

    def reset(self):
        self._excess, self._since_ns = (0.0,) * len(self._limits), 0

    def engage(self, t_ns, old, new):
        steps = [b - a for a, b in zip(old, new)]
        excess = (
            step - math.copysign(limit, step) if math.isfinite(step) and abs(step) > limit else 0.0
            for step, limit in zip(steps, self._limits)
        )
        self._excess, self._since_ns = tuple(excess), t_ns

    def apply(self, t_ns, value):
        age_ns = t_ns - self._since_ns
        if age_ns >= LIMITED_FOR_NS or not any(self._excess):
            return value
        share = 1.0 - age_ns / LIMITED_FOR_NS
        return tuple(v - excess * share for v, excess in zip(value, self._excess))


class CommandArbiter:
    """Records, set points and the choice between them."""

    def __init__(self, limits):
        self.record = self._previous = None
        self._announced = []
        self.refused_epoch = 0
        self.failed_over = self.tripped = False
        # Epoch of the first of the records in a row that name the owner and the fallback of now.
        self._hands_epoch = 0
        self._tripped_ns = self._tripped_epoch = 0
        self.open_ns = 0
        # By seat the newest set point of owner and fallback; those in effect at the last turn and at the
        # last decision.
        self._held = {}
        self._carried = self._last = None
        self._limiter = Limiter(limits)
        self._given = None
        self._kind_changes = False

    def take_record(self, record):
        """Takes in an owner record."""
        newest = self._announced[-1] if self._announced else self.record
        if newest and record.epoch <= newest.epoch:
            return
        if record.effective_ns < self.open_ns:
            if self.failed_over or not self.record or self.record.hands() != record.hands():
                self.refused_epoch = record.epoch
                return
            record = record._replace(effective_ns=self.open_ns)
        # The newest record of an instant counts: those for it or for a later one are void.
        self._announced = [r for r in self._announced if r.effective_ns < record.effective_ns]
        self._announced.append(record)

    def advance(self, t_ns):
        """Puts the record into effect that is due."""
        followed = self.seat if self.record and self.record.is_taken(self.seat) else None
        turned = False
        while self._announced and self._announced[0].effective_ns <= t_ns:
            self._previous, self.record = self.record, self._announced.pop(0)
            hands, before = self.record.hands(), self._previous
            is_same = before is not None and before.hands() == hands
            if not is_same:
                self._hands_epoch = self.record.epoch
            # Without a fallback the owner that tripped may have been started again since, unless it was judged by
            # this record already, which has come late.
            has_same_owner = before is not None and before.owner == self.record.owner
            is_meant = has_same_owner and self._tripped_epoch >= self.record.epoch
            self.tripped = self.tripped and (is_meant or (is_same and hands[1] is not None))
            self.failed_over = self.failed_over and self.tripped and is_same
            turned = True
        if turned:
            self._kind_changes = self.record.kind_changed and self.seat != followed
            self._carried = self._last
            self._held = {s: c for s, c in self._held.items() if self.record.is_taken(s)}

    def trip(self, epoch, instance, at_ns):
        """Takes the monitor's trip of the owner of an epoch, which is not followed any more: the fallback counts as
        soon as it has a valid set point after `backup_until_ns`, and no set point until then. A record that has left
        owner and fallback in place since does not outdate it; and the epoch may be one that was refused here or is
        yet to come, while the owner is the same."""
        record = self.record
        is_current = record and self._hands_epoch <= epoch
        is_meant = is_current and record.watched and record.owner == instance
        if is_meant and not self.tripped and not self.failed_over:
            self.tripped, self._tripped_epoch = True, epoch
            self._tripped_ns = max(at_ns, self.open_ns)

    @property
    def seat(self):
        """Seat whose set points count; None before the first record."""
        if self.record is None:
            return None
        return self.record.fallback if self.failed_over else self.record.owner

    def two_periods_ns(self, seat):
        """How long a set point of a seat is valid."""
        is_taken = self.record is not None and seat is not None and self.record.is_taken(seat)
        return 2 * self.record.periods_ns[seat] if is_taken else 0

    def may_command(self, seat, t_ns):
        """True if a set point of a seat for an instant is its owner's or its fallback's."""
        known = [self._previous, self.record, *self._announced]
        judges = [record for record in known if record and record.effective_ns <= t_ns]
        return bool(judges) and judges[-1].may_command(seat)

    def offer(self, command):
        """Keeps a set point that may count."""
        held = self._held.get(command.seat)
        is_taken = self.record is not None and self.record.is_taken(command.seat)
        if is_taken and (held is None or held.valid_ns <= command.valid_ns):
            self._held[command.seat] = command

    def carry(self, command):
        """Takes a set point as the one in effect when this loop joined, until the owner publishes."""
        self._carried = command

    def decide(self, t_ns):
        """The set point to follow at an instant; None if no seat has a valid one."""
        record = self.record
        if record is None:
            return None
        self.open_ns = max(self.open_ns, t_ns + 1)
        owners, fallbacks = self._valid(record.owner, t_ns), self._valid(record.fallback, t_ns)
        if self._carried and self._carried.is_valid(t_ns):
            # What the new owner published while it was the fallback counts only once nothing else does.
            is_from_before = owners is not None and owners.valid_ns < record.effective_ns
            if owners is None or (is_from_before and self._carried.seat != record.owner):
                owners = self._carried
        if owners is not None and not self.failed_over and not self.tripped:
            choice = owners
        else:
            choice = fallbacks
            self.failed_over = self.failed_over or choice is not None
        self._last = choice
        return None if choice is None else self._limited(choice, t_ns)

    def backup_until_ns(self):
        """Until when no set point counts after a trip, unless a record names another owner: the fallback has two periods
        to see what the backup law does. It would begin with what its predecessor has tripped for."""
        if not self.tripped or self.failed_over:
            return 0
        return self._tripped_ns + self.two_periods_ns(self.record.fallback)

    def reject(self, t_ns):
        """Decides that nothing counts at an instant, whatever owner and fallback publish."""
        self.open_ns = max(self.open_ns, t_ns + 1)
        self._last = None

    def forget_tripped(self):
        """The last heading of an owner that has tripped while there is no set point of another yet, if that is so: nothing
        has to continue from its own. A loop that has followed none has no heading either."""
        if self._given is None or (self._given.seat is not None and not (self.tripped and not self.failed_over)):
            return None
        self._given = self._given._replace(seat=None)
        self._limiter.reset()
        return self._given.value[3]

    def lapsed(self, t_ns):
        """The last set point that was followed, if its end is past."""
        given = self._given
        is_over = given is not None and given.seat is not None and t_ns >= given.valid_until_ns
        return given if is_over else None

    def replace_lapsed(self, value):
        """Sets what is followed in place of one that has lapsed: a change of kind continues from it."""
        self._given = self._given._replace(value=value)

    def _valid(self, seat, t_ns):
        held = self._held.get(seat)
        return held if held and held.is_valid(t_ns) else None

    def _limited(self, choice, t_ns):
        by_owner = not self.failed_over and choice.seat == self.record.owner
        given = self._given
        if given is None or choice.seat != given.seat:
            is_continued = given is not None and given.seat is not None
            if is_continued and by_owner and self._kind_changes:
                old = self._valid(given.seat, t_ns)
                old = given.value if old is None else self._limiter.apply(t_ns, old.value)
                self._limiter.engage(t_ns, old, choice.value)
            else:
                self._limiter.reset()
        if by_owner or self.failed_over:
            self._kind_changes = False
        self._given = choice._replace(value=self._limiter.apply(t_ns, choice.value))
        return self._given


class SetPoints:
    """The set point that an attitude loop has to follow."""

    def __init__(self, vehicle, role):
        self._vehicle, self._role = vehicle, role
        tilt_rad = STEP_SHARE * TILT_BOUND_RAD
        # The heading comes from the reference whichever process owns the slot, and it wraps: never limited.
        self._arbiter = CommandArbiter((STEP_SHARE * vehicle.weight_n, tilt_rad, tilt_rad, math.inf))
        self._faded_ns, self._excess = 0, (0.0, 0.0, 0.0)

    def take(self, t_ns, owners, setpoints, trips, estimate, reference):
        """The set point at an instant, from the inputs `position_owner`, `attitude_setpoint` and `trip`, and the
        newest state estimate and reference, if there are any; None if none is valid, and the last one stays; one is
        for two control periods of its writer. After two more without another, the last one fades, and a backup law
        follows the reference; if the owner has tripped and no fallback has taken over yet, it does so at once.
        Both have the sequence 0 of no set point."""
        arbiter = self._arbiter
        joins = arbiter.record is None
        records = [owners.before] if joins and owners.before else []
        for sample in (*records, *owners.fresh):
            arbiter.take_record(record_of(owners.value_of(sample)))
        if joins and setpoints.before:
            arbiter.advance(setpoints.before.valid_ns)
            command = self._judge(setpoints, setpoints.before)
            if command:
                arbiter.carry(command)
        if joins and trips.before:
            self._trip(trips, trips.before)
        waiting = list(trips.fresh)
        fresh = setpoints.fresh
        for index, sample in enumerate(fresh):
            # One that comes late counts from the last decision on, which stays as it was.
            at_ns = max(sample.valid_ns, arbiter.open_ns)
            self._take_trips(at_ns, trips, waiting)
            arbiter.advance(at_ns)
            command = self._judge(setpoints, sample)
            if command:
                arbiter.offer(command)
            is_last = index + 1 == len(fresh) or fresh[index + 1].valid_ns != sample.valid_ns
            if is_last and at_ns < t_ns:
                self._decide(at_ns)
        self._take_trips(t_ns, trips, waiting)
        arbiter.advance(t_ns)
        return (
            self._decide(t_ns)
            or self._replace_tripped(t_ns, estimate, reference)
            or self._fade(t_ns, estimate, reference)
        )

    def _decide(self, t_ns):
        """The set point that counts at an instant; None while the backup law is to follow the reference."""
        arbiter = self._arbiter
        if t_ns < arbiter.backup_until_ns():
            arbiter.reject(t_ns)
            return None
        return arbiter.decide(t_ns)

    def _replace_tripped(self, t_ns, estimate, reference):
        """What is followed in place of an owner that has tripped while there is no other yet."""
        yaw_rad = self._arbiter.forget_tripped()
        if yaw_rad is None:
            return None
        value = backup_of(t_ns, self._vehicle, yaw_rad, estimate, reference)
        return Command(value, 0, None, 0, 0)

    def _fade(self, t_ns, estimate, reference):
        """What is followed in place of the last set point when its end is two periods past."""
        last = self._arbiter.lapsed(t_ns)
        if last is None:
            return None
        two_periods_ns = last.valid_until_ns - last.valid_ns
        from_ns = last.valid_until_ns + two_periods_ns
        since_ns = t_ns - max(from_ns, self._faded_ns)
        if since_ns < 0:
            return None
        *law, yaw_rad = backup_of(t_ns, self._vehicle, last.value[3], estimate, reference)
        if self._faded_ns < from_ns:
            self._excess = tuple(value - own for value, own in zip(last.value, law))
        left = FADES_S / (FADES_S + since_ns * 1e-9)
        self._excess = tuple(left * excess for excess in self._excess)
        value = (*together(law, self._excess, last.value, self._vehicle), yaw_rad)
        self._faded_ns = t_ns
        self._arbiter.replace_lapsed(value)
        return Command(value, 0, None, 0, 0)

    def _take_trips(self, until_ns, trips, waiting):
        """Takes the trips in effect until an instant, each at its own, ahead of the set points then."""
        arbiter = self._arbiter
        while waiting and waiting[0].valid_ns <= until_ns:
            sample = waiting.pop(0)
            at_ns = max(sample.valid_ns, arbiter.open_ns)
            arbiter.advance(at_ns)
            self._trip(trips, sample)
            if at_ns < until_ns:
                self._decide(at_ns)

    def _trip(self, trips, sample):
        trip = trips.value_of(sample)
        if trip.slot == self._role:
            self._arbiter.trip(trip.epoch, trip.instance, sample.valid_ns)

    def _judge(self, setpoints, sample):
        """A set point that is fit to be followed; one that is not finite is its writer's silence."""
        if not self._arbiter.may_command(sample.seat, sample.valid_ns):
            return None
        asked = setpoints.value_of(sample)
        value = (asked.thrust_n, asked.roll_rad, asked.pitch_rad, asked.yaw_rad)
        if not all(map(math.isfinite, value)):
            return None
        until_ns = sample.valid_ns + self._arbiter.two_periods_ns(sample.seat)
        return Command(value, sample.sequence, sample.seat, sample.valid_ns, until_ns)

    def tell(self, applied, no_seat):
        """Fills the commanding seat into a sample of `applied_setpoint`."""
        arbiter = self._arbiter
        applied.epoch = arbiter.record.epoch if arbiter.record else 0
        applied.refused_epoch = arbiter.refused_epoch
        applied.seat = no_seat if arbiter.seat is None else arbiter.seat
        applied.failed_over = arbiter.failed_over
        applied.tripped = arbiter.tripped


def record_of(sample):
    """An owner record as it is followed."""
    return Record(
        sample.epoch,
        sample.owner,
        sample.fallback,
        sample.header.valid_ns,
        tuple(sample.period_ns),
        sample.kind_changed != 0,
        sample.watched != 0,
    )
