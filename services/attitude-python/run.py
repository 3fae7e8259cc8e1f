"""A Python process as part of a morphquad run, in realtime.

Joins the run, finds its ports, takes a seat, and tells everybody how far it has got; ARCHITECTURE.md,
"A controller in another language", has the rules. What is to be computed is in attitude_pd.py.
"""

import argparse
import ctypes
import fcntl
import gc
import importlib.util
import os
import pathlib
import select
import shutil
import signal
import subprocess
import sys
import time
import tomllib

import iceoryx2 as iox2

FOREVER = 2**64 - 1
WAIT_LIMIT_S = 0.02
HANDOVER_LIMIT_S = 5.0
STATS_PERIOD_NS = 100_000_000
# Exit codes of a run's processes.
PASS, UNFIT, CRASHED, INTERRUPTED = 0, 3, 4, 130


class Unfit(Exception):
    """Why this process cannot take part."""


def arguments(description):
    """What the launcher tells a controller."""
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


def load_samples(launcher_pid):
    """The module that `morphquad types --python` writes: the one beside this file, or the run's own."""
    beside = pathlib.Path(__file__).with_name("samples.py")
    if beside.exists():
        text = beside.read_text()
    else:
        launcher = f"/proc/{launcher_pid}/exe"
        command = [launcher, "types", "--python"]
        text = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    samples = importlib.util.module_from_spec(importlib.util.spec_from_loader("samples", None))
    exec(compile(text, "samples.py", "exec"), samples.__dict__)
    return samples


def now_ns():
    """CLOCK_MONOTONIC [ns]."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


class Reader:
    """What the processes of a role publish on a service, and nobody else."""

    def __init__(self, subscriber, sample_type, passes):
        self._subscriber = subscriber
        self._type = sample_type
        self._passes = passes

    def receive(self):
        """Everything that has come since the last time, oldest first."""
        samples = []
        while (sample := self._subscriber.receive()) is not None:
            # A copy: what is borrowed from the transport goes back at once.
            value = self._type.from_buffer_copy(sample.payload().contents)
            if self._passes(sample.header.node_id.value, value):
                samples.append(value)
            sample.delete()
        return samples


class Writer:
    """A topic or service to publish on."""

    def __init__(self, publisher):
        self._publisher = publisher

    def send(self, value):
        self._publisher.loan_uninit().write_payload(value).send()


class Process:
    """A seat of a slot, from joining the run to leaving it."""

    def __init__(self, options, name):
        self.options = options
        self._stop = False
        for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
            signal.signal(number, self._on_signal)
        if options.cpu is not None:
            os.sched_setaffinity(0, [options.cpu])
        if options.nice is not None:
            os.nice(options.nice)
        # Everybody holds this lock; whoever leaves last wipes.
        self._lock = open(options.run / "run.lock", "r+b")
        fcntl.flock(self._lock, fcntl.LOCK_SH | fcntl.LOCK_NB)
        self._launcher = os.pidfd_open(options.launcher_pid)
        self.samples = load_samples(options.launcher_pid)
        self.flight = tomllib.loads((options.run / "flight.toml").read_text())
        if self.flight["clock"] != "realtime":
            raise Unfit("it flies with the wall clock only: --clock realtime")
        self.role = self.samples.Role[options.slot.capitalize()]
        loops = {loop["role"]: loop for loop in self.flight["loops"]}
        self.loop = loops[options.slot]
        self.millihertz = round(self.loop["rate_hz"] * 1000)
        self.period_ns = -(-(10**12) // self.millihertz)
        self._take_priority()
        iox2.set_log_level(iox2.LogLevel.Fatal)
        path = iox2.FilePath.new(str(options.run / "iceoryx2.toml"))
        config = iox2.config.setup_global_config_from_file(path)
        self._node = (
            iox2.NodeBuilder.new()
            .name(iox2.NodeName.new(name))
            .config(config)
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .create(iox2.ServiceType.Ipc)
        )
        self._roll_reader = self._read("roll", self.samples.Roll, 2, None)
        self._roll = {}
        self._clock_reader = self._read("clock", self.samples.ClockRecord, 2, None)
        self.clock = self.samples.ClockRecord()
        self._owners = self._read(f"{options.slot}_owner", self.samples.OwnerRecord, 16, None)
        seat = self.samples.seat_label(self.role, options.seat)
        self._progress = self._write(f"progress/{seat}", self.samples.Progress)
        self._stats = self.writer("loop_stats")
        self._wake = os.open(options.run / f"wake-{seat}", os.O_RDWR | os.O_NONBLOCK)
        self._poll = select.poll()
        self._poll.register(self._wake, select.POLLIN)
        self._handover = self._open_handover(f"handover/{seat}")
        self.index = 0
        self.track_until_ns = 0
        self.steps = self.skipped = self.missed = 0
        self._leave_ns = FOREVER
        self._grace_ends_ns = FOREVER
        self._stats_sequence = 0
        self._stats_due_ns = 0

    def _on_signal(self, _number, _frame):
        self._stop = True

    def _take_priority(self):
        claim = self.loop["claim"]
        if claim["cpus"] and self.options.cpu is None:
            os.sched_setaffinity(0, claim["cpus"])
        if self.flight["realtime"]["policy"] == "fifo" and claim["priority"] > 0:
            try:
                scheduling = os.sched_param(claim["priority"])
                os.sched_setscheduler(0, os.SCHED_FIFO, scheduling)
            except PermissionError:
                pass  # The launcher says so.

    # Ports.

    def _service(self, name, sample_type):
        verifier = iox2.AttributeVerifier.new().require(
            iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(sample_type.LAYOUT)
        )
        builder = self._node.service_builder(iox2.ServiceName.new(name))
        try:
            return builder.publish_subscribe(sample_type).open_with_attributes(verifier)
        except iox2.PublishSubscribeOpenError as error:
            raise Unfit(
                f"service {name}: {sample_type.__name__} is not laid out as {sample_type.LAYOUT} "
                f"in this run, or it has no such service ({error}): remove samples.py"
            ) from error

    def _read(self, name, sample_type, depth, role, seat=None):
        subscriber = self._service(name, sample_type).subscriber_builder().buffer_size(depth).create()
        if role is None:
            # Only the launcher can write it: the transport refuses a second writer.
            return Reader(subscriber, sample_type, lambda _node, _value: True)
        return Reader(subscriber, sample_type, lambda node, v: self._is_from(node, v, role, seat))

    def _write(self, name, sample_type):
        return Writer(self._service(name, sample_type).publisher_builder().create())

    def reader(self, topic, depth=64):
        """What is published on a topic by those whose it is."""
        of = self.samples.TOPICS[topic]
        supervisor = of.producer == self.samples.Role.Supervisor
        return self._read(topic, of.type, depth, None if supervisor else of.producer)

    def marks_of(self, label):
        """How far the only seat of a role has got."""
        role = self.samples.Role[label.capitalize()]
        return self._read(f"progress/{label}", self.samples.Progress, 4, role, 0)

    def writer(self, topic):
        return self._write(topic, self.samples.TOPICS[topic].type)

    def _open_handover(self, name):
        service = self._node.service_builder(iox2.ServiceName.new(name))
        service = service.publish_subscribe(iox2.Slice[ctypes.c_uint8])
        return service.user_header(self.samples.Header).open().subscriber_builder().create()

    # Who is who: the writer as the transport names it must sit where its sample says.

    def _is_from(self, node, value, role, seat):
        entry = self._roll.get(node)
        if entry is None:
            self._learn_roll()
            entry = self._roll.get(node)
        if entry is None or entry.role != role or (seat is not None and entry.seat != seat):
            return False
        header = getattr(value, "header", None)
        if header is None:
            return value.generation == entry.generation
        return (header.seat, header.generation) == (entry.seat, entry.generation)

    def _learn_roll(self):
        for roll in self._roll_reader.receive():
            entries = roll.entries[: min(roll.count, self.samples.ROLL_LINES)]
            self._roll = {(entry.node[0] << 64) | entry.node[1]: entry for entry in entries}

    # Taking the seat.

    def take_seat(self):
        """Says hello and, if told to, waits for the instant at which to begin."""
        self._hello = self._write("hello", self.samples.Hello)
        self._hello.send(
            self.samples.Hello(
                # It publishes no state, so nobody is of its kind, and nobody's state is for it.
                state_layout=int.from_bytes(os.urandom(8)),
                period_ns=self.period_ns,
                pid=os.getpid(),
                generation=self.options.generation,
                role=self.role,
                seat=self.options.seat,
            )
        )
        if self.options.await_handover:
            order = self._await_handover()
            self.track_until_ns = order.track_until_ns
        while not self._look_around() and self.ending() is None:
            self.wait(WAIT_LIMIT_S)
        if self.options.await_handover:
            # Without an instant to join at, a dead predecessor is to be replaced at once.
            self.index = self._first_at_or_after(order.join_ns or self._logical_ns(now_ns()))
        self.announce(self.release_ns)

    def _await_handover(self):
        limit_ns = now_ns() + int(HANDOVER_LIMIT_S * 1e9)
        while now_ns() < limit_ns and self.ending() is None:
            while (sample := self._handover.receive()) is not None:
                generation = sample.user_header().contents.generation
                packed = bytes(sample.payload().as_memory_view())
                sample.delete()
                if generation == self.options.generation:
                    # Without padding the packed form of a structure is its form in memory.
                    return self.samples.Handover.from_buffer_copy(packed)
            self.wait(0.002)
        raise Unfit(f"no hand-over within {HANDOVER_LIMIT_S:g} s")

    # Time. Release k of a loop is at floor(k * 10^9 / rate) ns of logical time.

    def _instant_of(self, index):
        return index * 10**12 // self.millihertz

    @property
    def release_ns(self):
        """The next release: everything before it has been published."""
        return self._instant_of(self.index)

    def _first_at_or_after(self, t_ns):
        index = t_ns * self.millihertz // 10**12
        return index if self._instant_of(index) >= t_ns else index + 1

    def mono_ns(self, t_ns):
        """CLOCK_MONOTONIC at an instant of logical time."""
        return self.clock.start_mono_ns + int(t_ns / self.clock.speed)

    def _logical_ns(self, mono_ns):
        return max(0, int((mono_ns - self.clock.start_mono_ns) * self.clock.speed))

    def wait(self, limit_s):
        """Waits until somebody wakes this process, or the limit is over."""
        if self._poll.poll(max(0.0, limit_s) * 1e3):
            try:
                while len(os.read(self._wake, 128)) == 128:
                    pass
            except BlockingIOError:
                pass

    def sleep_until(self, mono_ns):
        """Sleeps until an instant of CLOCK_MONOTONIC, at most for the wait limit."""
        time.sleep(min(max(0, mono_ns - now_ns()) * 1e-9, WAIT_LIMIT_S))

    def skip_late_releases(self):
        """An old command is worth nothing: goes on with the newest release that is due."""
        newest = self._first_at_or_after(self._logical_ns(now_ns()) + 1) - 1
        if newest > self.index:
            self.skipped += newest - self.index
            self.index = newest

    # How far it has got, and when to leave.

    def announce(self, mark_ns):
        """Says that everything before this instant has been published."""
        self._progress.send(
            self.samples.Progress(
                mark_ns=mark_ns,
                steps=self.steps,
                publish_mono_ns=now_ns(),
                generation=self.options.generation,
                pid=os.getpid(),
            )
        )

    def header(self, cause, receive_mono_ns, start_mono_ns):
        """What all samples of a step have in common that goes by the sample of header `cause`."""
        return self.samples.Header(
            release_ns=self.release_ns,
            cause_sequence=cause.cause_sequence,
            input_sequence=cause.sequence,
            receive_mono_ns=receive_mono_ns,
            release_mono_ns=self.mono_ns(self.release_ns),
            start_mono_ns=start_mono_ns,
            publish_mono_ns=now_ns(),
            seat=self.options.seat,
            generation=self.options.generation,
        )

    def finish_step(self):
        """Counts a step, tells of it and goes to the next release."""
        self.steps += 1
        if self.release_ns >= self._stats_due_ns:
            self._send_stats()
        self.index += 1
        self.announce(self.release_ns)

    def _send_stats(self):
        self._stats_due_ns = (self.release_ns // STATS_PERIOD_NS + 1) * STATS_PERIOD_NS
        self._stats_sequence += 1
        stats = self.samples.LoopStats(
            steps=self.steps,
            skipped=self.skipped,
            input_deadline_misses=self.missed,
            generation=self.options.generation,
            role=self.role,
        )
        stats.header = self.header(self.samples.Header(), 0, now_ns())
        stats.header.sequence = self._stats_sequence
        stats.header.valid_ns = self.release_ns
        # Of all loops of a run this is the one of a role and a seat.
        stats.header.seat = 8 * self.options.seat + self.role
        self._stats.send(stats)

    def _look_around(self):
        """Learns what the launcher has said; true once the flight has begun."""
        self._learn_roll()
        for self.clock in self._clock_reader.receive():
            pass
        for record in self._owners.receive():
            leaves = record.period_ns[self.options.seat] == 0
            self._leave_ns = record.header.valid_ns if leaves else FOREVER
        return self.clock.started != 0

    def ending(self):
        """The exit code if it is time to leave, else None."""
        if self._stop:
            return INTERRUPTED
        if self._grace_ends_ns == FOREVER and select.select([self._launcher], [], [], 0)[0]:
            # Hovering and landing are the position loop's; it flies on until that is over.
            grace_s = self.flight["grace_s"]
            self._grace_ends_ns = now_ns() + int(1e9 * (grace_s + 4.0 if grace_s > 0.0 else 0.0))
        return CRASHED if now_ns() > self._grace_ends_ns else None

    def fly(self, is_final, step):
        """Runs every release until the end of the flight, or until the seat is given up.

        is_final(t_ns) tells whether the inputs of the step at t_ns are all there; step(t_ns) publishes.
        """
        deadline_ns = max(
            edge["deadline_ns"] for edge in self.flight["edges"] if edge["to"] == self.options.slot
        )
        while (ending := self.ending()) is None:
            self._look_around()
            t_ns = self.release_ns
            if t_ns >= self._leave_ns or t_ns >= self.clock.end_ns:
                return self._leave(t_ns)
            due_ns, until_ns = self.mono_ns(t_ns), self.mono_ns(t_ns + deadline_ns)
            final = is_final(t_ns)
            if not final and now_ns() < until_ns:
                self.wait(min((until_ns - now_ns()) * 1e-9, WAIT_LIMIT_S))
            elif now_ns() < due_ns:
                self.sleep_until(due_ns)
            else:
                self.skip_late_releases()
                if self.release_ns == t_ns:
                    self.missed += not final
                    step(t_ns)
                    self.finish_step()
                else:
                    self.announce(self.release_ns)
        return ending

    def _leave(self, t_ns):
        self._send_stats()
        self.announce(FOREVER)
        # A flight that is over has readers that are not done yet; a seat that is given up has not.
        while t_ns < self._leave_ns and self.ending() is None and not self.clock.may_leave:
            self.wait(WAIT_LIMIT_S)
            self._look_around()
        return PASS

    def close(self):
        """Leaves the run; the last one to leave wipes it."""
        run, lock = self.options.run, self._lock
        # Ports and node go first, while the run is still there.
        self.__dict__.clear()
        gc.collect()
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return
        prefix = f"mqshm-{run.name.removeprefix('mq-')}_"
        for entry in pathlib.Path("/dev/shm").glob(f"{prefix}*"):
            entry.unlink(missing_ok=True)
        shutil.rmtree(run, ignore_errors=True)


def main(name, description, fly):
    """Flies as the process `name`; fly(process) gives the exit code."""
    process = None
    try:
        process = Process(arguments(description), name)
        code = fly(process)
    except (Unfit, OSError, subprocess.CalledProcessError) as error:
        print(f"{name}: {error}", file=sys.stderr)
        code = UNFIT
    if process is not None:
        process.close()
    return code
