"""A process of a run: takes a seat, learns which others there are and how far they are, reports how far it is."""

import argparse
import contextlib
import ctypes
import fcntl
import functools
import gc
import hashlib
import math
import os
import pathlib
import select
import shlex
import shutil
import signal
import sys
import tomllib

from .graph import Graph
from .launcher import Launcher
from .loop import OWNED, Loop
from .lockstep import fly_lockstep
from .ownership import FOREVER, SeatMarks
from .ports import Bus, Types, Unfit, now_ns
from .realtime import fly_realtime

# After so long of a wait shared memory is read again [s].
WAIT_LIMIT_S = 0.02
HANDOVER_LIMIT_S = 5.0
# Longest grace of a flight in lockstep, which no launcher can take over [s].
LOCKSTEP_GRACE_S = 2.0
# Exit codes of a run's processes.
PASS, UNFIT, CRASHED, INTERRUPTED = 0, 3, 4, 130


def arguments(description, slot):
    """What the launcher passes to a controller."""
    if len(sys.argv) == 1:
        file = os.path.abspath(sys.argv[0])
        swap = shlex.quote(f"{slot}={file}@2s")
        print(f"{file}: {description}; fly it with `morphquad run hover --swap {swap}`", file=sys.stderr)
        sys.exit(2)
    parser = argparse.ArgumentParser(description=description)
    parser.add_argument("--slot", required=True, choices=["attitude", "position"])
    parser.add_argument("--run", required=True, type=pathlib.Path, help="folder of the run")
    parser.add_argument("--generation", required=True, type=int)
    parser.add_argument("--launcher-pid", required=True, type=int)
    parser.add_argument("--seat", type=int, default=0)
    parser.add_argument("--await-handover", action="store_true")
    parser.add_argument("--config", type=pathlib.Path, help="gains, as TOML")
    parser.add_argument("--cpu", type=int)
    parser.add_argument("--nice", type=int)
    return parser.parse_args()


def own_name():
    """Name of the file that is run, without its ending."""
    return pathlib.Path(sys.argv[0]).stem


def three_numbers(name, given):
    """What a law has given, as a tuple."""
    try:
        numbers = tuple(float(number) for number in given)
    except TypeError:
        raise TypeError(f"{name} gave {given!r}, and three numbers are needed") from None
    if len(numbers) != 3:
        raise TypeError(f"{name} gave {len(numbers)} numbers, and three are needed")
    return numbers


def configured(path, gains):
    """Gains, with those that the file at `path` replaces; all of them if there is no file."""
    if path is None:
        return dict(gains)
    try:
        own = tomllib.loads(path.read_text())
    except (OSError, UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise Unfit(f"{path} cannot be read: {error}") from error
    unknown = sorted(own.keys() - gains.keys())
    if unknown:
        raise Unfit(f"{path}: there is no gain {', '.join(unknown)}: it has {', '.join(sorted(gains))}")
    return {**gains, **own}


def described(run):
    """What the launcher has noted of the flight in a run's folder."""
    return tomllib.loads((run / "flight.toml").read_text())


def leave_s(flight):
    """How long a process stays without a launcher, by the wall clock [s]."""
    grace_s, landing_s, speed = flight["grace_s"], flight["landing_s"], flight["speed"]
    if flight["clock"] != "realtime":
        return min(grace_s, LOCKSTEP_GRACE_S)
    # Hovering and landing are the position loop's; an attitude loop flies on until that is over.
    return (grace_s + landing_s) / speed if grace_s > 0.0 else 0.0


def leave_s_of(run, flight):
    """The same now, when a landing may take longer than as the flight began: from where the vehicle has been sent."""
    try:
        return leave_s(described(run))
    except (OSError, KeyError, tomllib.TOMLDecodeError):
        return leave_s(flight)


class Process:
    """A seat of a slot, from joining the run to leaving it."""

    def __init__(self, options, name):
        self.options = options
        self._stop = False
        # What a law prints is seen at once, though it goes through a pipe.
        sys.stdout.reconfigure(line_buffering=True)
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)
        if options.cpu is not None:
            os.sched_setaffinity(0, [options.cpu])
        if options.nice is not None:
            os.nice(options.nice)
        # Every process of a run holds this lock; the last one to leave wipes.
        self._lock = open(options.run / "run.lock", "r+b")
        fcntl.flock(self._lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        types = Types(options.launcher_pid)
        self.slot = options.slot
        try:
            self.flight = described(options.run)
            leave_s(self.flight)
            self.is_realtime = self.flight["clock"] == "realtime"
            self.graph = Graph(self.flight, self.slot)
        except (KeyError, tomllib.TOMLDecodeError) as error:
            raise Unfit(
                f"{options.run}/flight.toml is of another build ({error}): use the controllers that "
                "came with this morphquad"
            ) from error
        watch = functools.partial(leave_s_of, options.run, self.flight)
        self._launcher = Launcher(options.run, options.launcher_pid, watch)
        if self.slot not in self.graph.rates:
            raise Unfit(f"this flight has no {self.slot} loop: choose another scenario")
        if self.is_realtime:
            self._take_priority()
        self.samples = types.load()
        self.marks = SeatMarks(self.samples.SEATS)
        self._bus = Bus(options.run, name, self.samples)
        self._clock_reader = self._bus.announced("clock", self.samples.ClockRecord, 2)
        self.clock = self.samples.ClockRecord()
        self._open_neighbours()
        label = self._bus.label(self.slot, options.seat)
        self._progress = self._bus.writer(f"progress/{label}", self.samples.Progress)
        self._mark = self.samples.Progress(generation=options.generation, pid=os.getpid())
        self._has_reported = False
        self._pipe = self._open_pipe(label)
        self._poll = select.poll()
        self._poll.register(self._pipe, select.POLLIN)
        self._handovers = self._bus.handovers(label)
        self._registry_changes = 0
        self.loop = None
        self.leave_ns = FOREVER
        # Whether the last wait was ended by its limit.
        self.timed_out = False

    def _on_signal(self, _number, _frame):
        self._stop = True

    def _take_priority(self):
        claim = next(one["claim"] for one in self.flight["loops"] if one["role"] == self.slot)
        if claim["cpus"] and self.options.cpu is None:
            os.sched_setaffinity(0, claim["cpus"])
        if self.flight["realtime"]["policy"] == "fifo" and claim["priority"] > 0:
            try:
                os.sched_setscheduler(0, os.SCHED_FIFO, os.sched_param(claim["priority"]))
            except PermissionError:
                pass  # The launcher reports it.

    def _open_pipe(self, label):
        # Both directions at each end: neither has to wait for, or survive, the other end.
        return os.open(self.options.run / f"wake-{label}", os.O_RDWR | os.O_NONBLOCK)

    def _open_neighbours(self):
        seats = {role: self.samples.SEATS if role in OWNED.values() else 1 for role in self.graph.rates}
        places = lambda roles: [(r, s) for r in sorted(roles) for s in range(seats[r])]  # noqa: E731
        self._mark_readers = [
            (role, seat, self._bus.marks(role, seat)) for role, seat in places(self.graph.producers)
        ]
        self._pipes = {
            (role, seat): self._open_pipe(self._bus.label(role, seat))
            for role, seat in places(self.graph.consumers)
        }
        # Of the process that sits there: generation and period [ns].
        self._present = dict.fromkeys([(r, s) for r, s, _ in self._mark_readers] + [*self._pipes])
        self._owner_readers = [
            (slot, self._bus.announced(topic, self.samples.OwnerRecord, 16))
            for topic, slot in OWNED.items()
            if slot == self.slot or slot in self.graph.producers
        ]

    # Taking the seat.

    def take_seat(self, topics):
        """Sends its hello with all ports open and, if ordered to, waits for the instant at which to begin."""
        options = self.options
        self.loop = Loop(self._bus, self.graph, self.marks, self.slot, options, topics)
        self._opened_mono_ns = now_ns()
        # It publishes no state, so no controller is of its kind, and no controller's state is for it.
        identity = f"{self.slot} {options.seat} {options.generation}".encode()
        self._hello = self._bus.writer("hello", self.samples.Hello)
        self._hello.send(
            self.samples.Hello(
                state_layout=int.from_bytes(hashlib.sha256(identity).digest()[:8]),
                period_ns=self.loop.rate.period_ns,
                pid=os.getpid(),
                generation=options.generation,
                role=self.samples.Role[self.slot.capitalize()],
                seat=options.seat,
            )
        )
        order = self._await_handover() if options.await_handover else None
        # Samples of a process that is not in the registry yet are not accepted.
        while not (self.read_clock().started and self._is_seated()):
            if self.ending() is not None:
                return
            self.wait(WAIT_LIMIT_S)
        self.look_around()
        if order is not None:
            # Without an instant to join at, a dead predecessor is to be replaced at once.
            self.loop.join(order.join_ns or self.logical_ns(now_ns()), order.track_until_ns)
        self._tell_mark(self.loop.mark_ns)
        # After a start no process knows what a predecessor had already announced.
        self._wake(lambda _role, _period_ns: True)

    def _is_seated(self):
        self._bus.learn_registry()
        own = (self.slot, self.options.seat, self.options.generation, True)
        return any(line[:4] == own for line in self._bus.registry)

    def _await_handover(self):
        # In lockstep time is held meanwhile, also if the launcher is stopped.
        limit_s = HANDOVER_LIMIT_S if self.is_realtime else math.inf
        begun_ns = now_ns()
        while now_ns() - begun_ns < 1e9 * limit_s and self.ending() is None:
            for _, packed in self._handovers.receive():
                header = self.samples.Header.from_buffer_copy(packed)
                if header.generation == self.options.generation:
                    # Without padding the packed form of a structure is its form in memory.
                    return self.samples.Handover.from_buffer_copy(packed, ctypes.sizeof(header))
            self.wait(0.002)
        raise Unfit(f"no hand-over within {HANDOVER_LIMIT_S:g} s")

    # Time.

    def read_clock(self):
        """The conductor's last record."""
        for self.clock in self._clock_reader.values():
            pass
        return self.clock

    def mono_ns(self, t_ns):
        """CLOCK_MONOTONIC at an instant of logical time, in realtime."""
        return self.clock.start_mono_ns + int(t_ns / self.clock.speed)

    def logical_ns(self, mono_ns):
        """Logical time at an instant of CLOCK_MONOTONIC, in realtime."""
        return max(0, int((mono_ns - self.clock.start_mono_ns) * self.clock.speed))

    def wait(self, limit_s):
        """Waits until another process wakes this one, or the limit is over."""
        self.timed_out = not self._poll.poll(max(0.0, limit_s) * 1e3)
        if self.timed_out:
            # Idle long enough to look after readers that have just joined.
            self.serve_again()
        else:
            try:
                while len(os.read(self._pipe, 128)) == 128:
                    pass
            except BlockingIOError:
                pass

    # Which processes there are, and how far they are.

    def look_around(self):
        """Learns which processes have come and gone, and which seat owns which slot from when."""
        self._bus.learn_registry()
        if self._bus.registry_changes != self._registry_changes:
            self._registry_changes = self._bus.registry_changes
            self._learn_neighbours()
        done_ns = (self.loop.previous_ns or 0) if self.loop else 0
        for slot, reader in self._owner_readers:
            book = self.marks.book(slot)
            for record in reader.values():
                book.learn(record)
            book.forget_before(done_ns)
            if slot == self.slot:
                self.leave_ns = book.released_ns(self.options.seat)

    def _learn_neighbours(self):
        self.marks.learn_registry(self._bus.registry)
        present = dict.fromkeys(self._present)
        for role, seat, generation, is_present, period_ns in self._bus.registry:
            if (role, seat) in present:
                present[role, seat] = (generation, period_ns) if is_present else None
        came = any(one is not None and one != self._present[at] for at, one in present.items())
        self._present = present
        if came:
            # Its ports are open and empty, and it does not trust earlier reports.
            self.serve_again()
            self._wake(lambda _role, _period_ns: True)

    def read_marks(self):
        """Reads how far those have got that this loop waits for; gives the roles that have moved."""
        moved = set()
        for role, seat, read in self._mark_readers:
            if self.marks.concerns(role, seat):
                for mark_ns, served_mono_ns, generation in read():
                    # A report from before all ports were open here may promise samples that have not come.
                    if served_mono_ns == 0 or served_mono_ns >= self._opened_mono_ns:
                        self.marks.advance(role, seat, generation, mark_ns)
                        moved.add(role)
        return moved

    def announce(self, before_ns, mark_ns):
        """Reports that everything before the mark has been published, and wakes those that may go on."""
        self._tell_mark(mark_ns)
        # No process waits for a shadow.
        if not self.marks.concerns(self.slot, self.options.seat):
            return
        roles = self.graph.wakes(before_ns, mark_ns)
        usual = self.graph.rates
        # At another rate than the flight's own a process is always worth waking.
        self._wake(lambda role, period_ns: role in roles or period_ns != usual[role].period_ns)

    def _wake(self, is_meant):
        for (role, seat), pipe in self._pipes.items():
            present = self._present[role, seat]
            if present is not None and is_meant(role, present[1]):
                try:
                    os.write(pipe, b"\1")
                except BlockingIOError:
                    pass  # A full pipe wakes just as well.

    def _tell_mark(self, mark_ns):
        self._mark.served_mono_ns = now_ns()
        if self.loop is not None:
            # A reader that has just joined must have the history before it learns of the mark.
            self.loop.serve_late_joiners()
            self._mark.steps = self.loop.steps
        self._mark.mark_ns = mark_ns
        self._has_reported = True
        self._progress.send(self._mark)

    def serve_again(self):
        """Gives readers that have just joined what was published before, and repeats the mark: they do not trust
        one from before their ports were open."""
        if self._has_reported:
            self._tell_mark(self._mark.mark_ns)
        elif self.loop is not None:
            self.loop.serve_late_joiners()

    # Leaving.

    @property
    def is_stopped(self):
        """True once a signal has asked for the end."""
        return self._stop

    def ending(self):
        """The exit code if it is time to leave, else None."""
        if self._stop:
            return INTERRUPTED
        return CRASHED if self._launcher.is_given_up else None

    def fly(self, law):
        """Runs every release until the end of the flight, or until the seat is given up."""
        # Nothing in flight makes rubbish in circles, and looking for it takes milliseconds.
        gc.collect()
        gc.freeze()
        gc.disable()
        return (fly_realtime if self.is_realtime else fly_lockstep)(self, law)

    def leave(self, is_retired):
        """Reports that nothing will follow. A flight that is over has readers that are not done yet; a
        seat that is given up has none."""
        self.loop.finish()
        self.announce(self.loop.mark_ns, FOREVER)
        while not is_retired and not self.read_clock().may_leave:
            if self.ending() is not None or self._launcher.is_gone:
                break
            self.wait(WAIT_LIMIT_S)
        return PASS

    def close(self):
        """Leaves the run; the last one to leave wipes it."""
        run, lock = self.options.run, self._lock
        # Ports and node go first, while the run is still there.
        self.__dict__.clear()
        gc.unfreeze()
        gc.collect()
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        prefix = f"mqshm-{run.name.removeprefix('mq-')}_"
        for entry in pathlib.Path("/dev/shm").glob(f"{prefix}*"):
            # What another user has put there cannot be removed, and stays.
            with contextlib.suppress(OSError):
                entry.unlink()
        shutil.rmtree(run, ignore_errors=True)


def main(name, description, slot, begin):
    """Flies as the process `name`: `begin(process)` gives the law and the topics that it reads and
    writes."""
    process, law = None, None
    try:
        options = arguments(description, slot)
        if options.slot != slot:
            raise Unfit(f"it flies the {slot} slot: --slot {slot}")
        process = Process(options, name)
        law, topics = begin(process)
        process.take_seat(topics)
        ending = process.ending()
        code = process.fly(law) if ending is None else ending
    except (Unfit, OSError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = UNFIT
    if process is not None:
        del law
        process.close()
    return code
