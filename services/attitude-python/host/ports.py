"""The run's services: opened, never created, and read only from processes in the registry, or from the launcher."""

import ctypes
import importlib.util
import pathlib
import struct
import subprocess
import time

import iceoryx2 as iox2

# Of a progress mark: the mark, until when the writer is quiet, when readers were served before it, and generation; of a
# header, seat and generation.
MARK = struct.Struct("<QQ8xQI")
ROOM_LIMIT_NS = 3_000_000_000
SEATED = struct.Struct("<72xII")


class Unfit(Exception):
    """Why this process cannot take part."""


def now_ns():
    """CLOCK_MONOTONIC [ns]."""
    return time.clock_gettime_ns(time.CLOCK_MONOTONIC)


def with_room(make):
    """Makes a port. A service admits only so many; those of dead processes count until the launcher has freed them."""
    give_up_ns = now_ns() + ROOM_LIMIT_NS
    while True:
        try:
            return make()
        except (iox2.PublisherCreateError, iox2.SubscriberCreateError):
            if now_ns() > give_up_ns:
                raise
            time.sleep(0.002)


class Types:
    """The module that `morphquad types --python` writes: the one beside the controllers, or the run's
    own, which is asked for in the background."""

    def __init__(self, launcher_pid):
        self._beside = pathlib.Path(__file__).parent.with_name("samples.py")
        self._asked = None
        if not self._beside.exists():
            command = [f"/proc/{launcher_pid}/exe", "types", "--python"]
            self._asked = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)

    def load(self):
        if self._asked is None:
            text = self._beside.read_text()
        else:
            text, _ = self._asked.communicate()
            if self._asked.returncode != 0:
                raise Unfit("the launcher does not tell the samples' types: is it of another build?")
        samples = importlib.util.module_from_spec(importlib.util.spec_from_loader("samples", None))
        exec(compile(text, "samples.py", "exec"), samples.__dict__)
        return samples


class Reader:
    """What arrives on a service: structures, perhaps with more bytes after each."""

    def __init__(self, subscriber, sample_type, passes, with_more):
        self._subscriber = subscriber
        size = ctypes.sizeof(sample_type)
        self._sizes = range(size, 1 << 63) if with_more else range(size, size + 1)
        self._type = sample_type
        self._passes = passes

    def receive(self):
        """All that has come since the last time and may be taken: instant of arrival, and its bytes."""
        arrived = []
        receive, passes, sizes = self._subscriber.receive, self._passes, self._sizes
        while (sample := receive()) is not None:
            mono_ns = now_ns()
            # A copy: what is borrowed from the transport goes back at once.
            payload = sample.payload()
            packed = ctypes.string_at(payload.as_ptr(), payload.len())
            if len(packed) in sizes and passes(sample.header.node_id.value, packed):
                arrived.append((mono_ns, packed))
            sample.delete()
        return arrived

    def values(self):
        """The same, as the structures that they are."""
        return [self._type.from_buffer_copy(packed) for _, packed in self.receive()]


class Writer:
    """A service to publish on."""

    def __init__(self, publisher):
        self._publisher = publisher

    def send(self, value):
        size = ctypes.sizeof(value)
        sample = self._publisher.loan_slice_uninit(size)
        ctypes.memmove(sample.payload_ptr, ctypes.byref(value), size)
        sample.assume_init().send()

    def serve_late_joiners(self):
        """Lets readers that have just joined have the history."""
        self._publisher.update_connections()


class Bus:
    """A process's connection to its run."""

    def __init__(self, folder, name, samples):
        self.samples = samples
        iox2.set_log_level(iox2.LogLevel.Fatal)
        path = iox2.FilePath.new(str(folder / "iceoryx2.toml"))
        self._node = (
            iox2.NodeBuilder.new()
            .name(iox2.NodeName.new(name))
            .config(iox2.config.setup_global_config_from_file(path))
            .signal_handling_mode(iox2.SignalHandlingMode.Disabled)
            .create(iox2.ServiceType.Ipc)
        )
        self._leader_file = folder / "launcher.node"
        # Connections that have written where the launcher alone may: whether they led then.
        self._leads = {self._named_leader(): True}
        self._registry_reader = self.announced("registry", samples.Registry, 2)
        self._labels = {role.value: role.name.lower() for role in samples.Role}
        # By identity of the writer: role, seat, generation, whether it is there, and its period [ns].
        self._registry = {}
        # How often the registry has changed.
        self.registry_changes = 0
        self.learn_registry()

    def learn_registry(self):
        """Learns which process sits where."""
        registries = self._registry_reader.values()
        if registries:
            registry = registries[-1]
            self.registry_changes += 1
            self._registry = {
                (line.node[0] << 64) | line.node[1]: (
                    self._labels.get(line.role, "unknown"),
                    line.seat,
                    line.generation,
                    line.present != 0,
                    line.period_ns,
                )
                for line in registry.entries[: min(registry.count, self.samples.REGISTRY_LINES)]
            }

    @property
    def registry(self):
        """Lines of the registry, in its order."""
        return self._registry.values()

    def _line(self, node):
        line = self._registry.get(node)
        if line is None:
            self.learn_registry()
            line = self._registry.get(node)
        return line

    def is_leader(self, node):
        """Whether a connection is the launcher's, or was that of one that has died: a file that others cannot write
        names it."""
        if node not in self._leads:
            # A launcher claims the lead before it writes anything, so that the answer stays.
            self._leads[node] = node == self._named_leader()
        return self._leads[node]

    def _named_leader(self):
        try:
            return int(self._leader_file.read_text(), 16)
        except (OSError, ValueError):
            return None

    # Ports.

    def _service(self, name, sample_type):
        verifier = iox2.AttributeVerifier.new().require(
            iox2.AttributeKey.new("layout"), iox2.AttributeValue.new(sample_type.LAYOUT)
        )
        builder = self._node.service_builder(iox2.ServiceName.new(name))
        try:
            return builder.publish_subscribe(iox2.Slice[ctypes.c_uint8]).open_with_attributes(verifier)
        except iox2.PublishSubscribeOpenError as error:
            raise Unfit(
                f"service {name}: {sample_type.__name__} is not laid out as {sample_type.LAYOUT} "
                f"in this run, or it has no such service ({error}): remove samples.py"
            ) from error

    def _read(self, name, sample_type, depth, passes, with_more=False):
        service = self._service(name, sample_type)
        subscriber = with_room(lambda: service.subscriber_builder().buffer_size(depth).create())
        return Reader(subscriber, sample_type, passes, with_more)

    def announced(self, name, sample_type, depth, with_more=False):
        """What the launcher alone may write."""
        return self._read(name, sample_type, depth, lambda node, _packed: self.is_leader(node), with_more)

    def topic(self, name, producer):
        """A topic, from processes of a role alone: each sample must come from the seat that it claims."""

        def passes(node, packed):
            line = self._line(node)
            return line is not None and line[0] == producer and line[1:3] == SEATED.unpack_from(packed)

        sample_type = self.samples.TOPICS[name].type
        if producer == "supervisor":
            return self.announced(name, sample_type, 1024)
        return self._read(name, sample_type, 1024, passes)

    def marks(self, role, seat):
        """How far the processes on a seat have got, as they come: instant before which nothing more comes from them,
        instant at which readers had been served [ns of CLOCK_MONOTONIC], and generation."""

        def passes(node, packed):
            line = self._line(node)
            return line is not None and line[:2] == (role, seat) and line[2] == MARK.unpack_from(packed)[-1]

        label = self.label(role, seat)
        reader = self._read(f"progress/{label}", self.samples.Progress, 2, passes)

        def received():
            for _, packed in reader.receive():
                mark_ns, quiet_until_ns, served_mono_ns, generation = MARK.unpack_from(packed)
                yield max(mark_ns, quiet_until_ns), served_mono_ns, generation

        return received

    def label(self, role, seat):
        """Name of a seat in services and pipes."""
        return self.samples.seat_label(self.samples.Role[role.capitalize()], seat)

    def writer(self, name, sample_type):
        service, size = self._service(name, sample_type), ctypes.sizeof(sample_type)
        return Writer(with_room(lambda: service.publisher_builder().initial_max_slice_len(size).create()))

    def handovers(self, label):
        """What the launcher hands to a process that takes a seat: a header, and then bytes."""
        return self.announced(f"handover/{label}", self.samples.Header, 2, with_more=True)
