#!/usr/bin/env python3
"""Checks a recording with readers that share no code with its writer.

    verify_recording.py FILE [--expect-topics N] [--allow-gaps] [--negative-controls] [--cut]

Reads the file twice, in file order (every CRC, every record) and through its index, decodes every
message by field name from the schemas in the file alone, counts again what the recorder says it
counted, and prints the totals. A file that says that it is recovered has no summary. With --cut, the file must
end in the middle, as a killed recorder leaves it, and is read up to there. Exit code 0: no problem; 1: problems; 2: wrong usage.
"""

import argparse
import io
import json
import math
import sys
from collections import Counter, defaultdict
from pathlib import Path

from google.protobuf.descriptor import FieldDescriptor
from google.protobuf.unknown_fields import UnknownFieldSet
from mcap.exceptions import EndOfFile
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Attachment, Channel, Chunk, Message, Metadata, Schema, Statistics
from mcap.stream_reader import StreamReader
from mcap_protobuf.decoder import DecoderFactory

COMMANDS = ("/wrench_command", "/attitude_setpoint")
TALLY_KEYS = ("count", "first", "last", "gaps", "repeated", "renumbered", "writers")


class Problems(list):
    """What is wrong, one line each; a flood of the same kind is cut."""

    LIMIT = 50

    def expect(self, condition, text):
        if not condition and len(self) < self.LIMIT:
            self.append(text)


class Decoded:
    """Totals over the values of all messages."""

    def __init__(self):
        self.values = 0
        self.not_finite = Counter()

    def walk(self, message, path, problems):
        """Reads every field by its name, nested messages included."""
        problems.expect(len(UnknownFieldSet(message)) == 0, f"{path}: bytes outside the schema")
        for field in message.DESCRIPTOR.fields:
            where = f"{path}.{field.name}"
            value = getattr(message, field.name)
            for item in value if is_repeated(field) else (value,):
                if field.type == FieldDescriptor.TYPE_MESSAGE:
                    self.walk(item, where, problems)
                    continue
                self.values += 1
                if field.type == FieldDescriptor.TYPE_DOUBLE and not math.isfinite(item):
                    self.not_finite[where] += 1
                if field.type == FieldDescriptor.TYPE_ENUM:
                    known = item in field.enum_type.values_by_number
                    problems.expect(known, f"{where}: {item} is no {field.enum_type.name}")


def is_repeated(field):
    # Newer versions of the library replace `label` by a property.
    repeated = getattr(field, "is_repeated", None)
    return field.label == FieldDescriptor.LABEL_REPEATED if repeated is None else repeated


class Audit:
    """The recorder's sequence audit, counted again from headers alone."""

    def __init__(self):
        self.tallies = {}
        self.last_release_ns = {}
        self.last_generation = {}
        # Of the slots' commands, which come once at a release, the time between two that follow each other.
        self.period_ns = {}

    def observe(self, topic, header, problems):
        key = f"{topic}#{header.seat}"
        sequence = header.sequence
        tally = self.tallies.setdefault(key, dict.fromkeys(TALLY_KEYS, 0))
        if tally["count"] == 0:
            tally["first"], tally["writers"] = sequence, 1
        elif sequence > tally["last"]:
            # A process that takes a seat in flight counts on from another seat's numbers.
            missing = sequence - tally["last"] - 1
            since_ns = max(header.release_ns - self.last_release_ns[key], 0)
            if header.generation == self.last_generation[key]:
                period_ns = self.period_ns.get(key)
                if missing == 0 and since_ns > 0:
                    self.period_ns[key] = min(since_ns, period_ns or since_ns)
                elif topic in COMMANDS and period_ns and missing >= max(since_ns // period_ns, 1):
                    tally["renumbered"] += 1
                else:
                    tally["gaps"] += missing
        else:
            went_on = header.release_ns > self.last_release_ns[key]
            problems.expect(went_on, f"{key}: sequence {sequence} was recorded twice")
            tally["renumbered"] += 1
        if header.generation != self.last_generation.get(key, header.generation):
            tally["writers"] += 1
            self.period_ns.pop(key, None)
        tally["count"] += 1
        tally["last"] = sequence
        self.last_release_ns[key] = header.release_ns
        self.last_generation[key] = header.generation

    def compare(self, recorded, problems):
        problems.expect(
            recorded.keys() == self.tallies.keys(),
            f"audit covers {sorted(recorded)}, the file holds {sorted(self.tallies)}",
        )
        for key, tally in sorted(self.tallies.items()):
            stored = json.loads(recorded.get(key, "{}"))
            # Repetitions are left out of the file, so only the recorder can know them.
            for name in TALLY_KEYS:
                same = name == "repeated" or stored.get(name) == tally[name]
                problems.expect(same, f"{key}: {name} is {tally[name]}, audit says {stored.get(name)}")
            tally["repeated"] = stored.get("repeated", 0)


class Derived:
    """What viewers draw: a message for the first sample in each period of the topic it is derived from."""

    PLACES = {"/truth": lambda m: m.position_w_m, "/state_estimate": lambda m: m.position_w_m,
              "/reference": lambda m: m.points[0].position_w_m}

    def __init__(self):
        self.sources = {}
        self.period = {}
        self.bytes = {True: 0, False: 0}

    def observe(self, record, channel, message, problems):
        source = channel.metadata.get("derived_from")
        self.bytes[source is not None] += len(record.data)
        if source is None:
            self.sources[channel.topic] = (record, message)
            return
        topic = channel.topic
        known = self.sources.get(source)
        problems.expect(known is not None, f"{topic}: comes before anything on {source}")
        if known is None:
            return
        sample, values = known
        same = (record.sequence, record.log_time) == (sample.sequence, sample.log_time)
        problems.expect(same, f"{topic}: {record.sequence} is not of {source} {sample.sequence}")
        period = values.header.release_ns // int(channel.metadata["period_ns"])
        problems.expect(self.period.get(topic) != period, f"{topic}: twice in period {period}")
        self.period[topic] = period
        place = None
        if topic == "/tf":
            place = next(f for f in message.transforms if f.child_frame_id == "vehicle").translation
        elif topic.startswith("/pose/"):
            place = message.pose.position
        if place is not None:
            expected = list(self.PLACES[source](values))
            problems.expect([place.x, place.y, place.z] == expected, f"{topic}: at {place}, not {expected}")

    def compare(self, channels, counts, releases, is_part, problems):
        for channel in channels.values():
            source = channel.metadata.get("derived_from")
            if source is None:
                continue
            period_ns = int(channel.metadata["period_ns"])
            periods = [release_ns // period_ns for release_ns in releases[source]]
            due = sum(1 for i, p in enumerate(periods) if i == 0 or p != periods[i - 1])
            found = counts[channel.topic]
            # Of the last sample before a cut, the message may have come behind it.
            holds = found == due or (is_part and found == due - 1)
            problems.expect(holds, f"{channel.topic}: {found} messages, {source} is worth {due}")


def records_of(data, is_cut, problems):
    """Every record, CRCs checked; of a cut file those before the cut."""
    records = iter(StreamReader(io.BytesIO(data), validate_crcs=True).records)
    while True:
        try:
            record = next(records)
        except StopIteration:
            problems.expect(not is_cut, "the file is complete, not cut")
            return
        except EndOfFile:
            if not is_cut:
                raise
            return
        yield record


def read_in_file_order(data, options, problems):
    """Every record, every CRC. Returns messages per topic, and what was decoded."""
    schemas, channels, decoders = {}, {}, {}
    metadata, attachments = {}, {}
    counts, decoded, audit, derived = Counter(), Decoded(), Audit(), Derived()
    releases = defaultdict(list)
    statistics = None
    factory = DecoderFactory()
    for record in records_of(data, options.cut, problems):
        if isinstance(record, Schema):
            schemas[record.id] = record
        elif isinstance(record, Channel):
            channels[record.id] = record
        elif isinstance(record, Metadata):
            metadata[record.name] = record.metadata
        elif isinstance(record, Attachment):
            attachments[record.name] = record.data
        elif isinstance(record, Statistics):
            statistics = record
        elif isinstance(record, Message):
            channel = channels[record.channel_id]
            if channel.id not in decoders:
                schema = schemas[channel.schema_id]
                decoders[channel.id] = factory.decoder_for(channel.message_encoding, schema)
            message = decoders[channel.id](record.data)
            counts[channel.topic] += 1
            decoded.walk(message, channel.topic, problems)
            check_stamps(record, channel, message, audit, problems)
            derived.observe(record, channel, message, problems)
            if hasattr(message, "header"):
                releases[channel.topic].append(message.header.release_ns)

    recovered = metadata.get("recovered")
    if recovered is not None:
        print(f"recovered from {recovered['from']}; {recovered.get('damage', 'it ended in a clean cut')}")
    is_part = options.cut or recovered is not None
    needed = ("run",) if options.cut else ("run", "audit") if is_part else ("run", "summary", "audit")
    for name in needed:
        problems.expect(name in metadata, f"metadata {name} is missing")
    problems.expect(attachments.get("scenario.toml"), "attachment scenario.toml is missing or empty")
    if not options.cut:
        audit.compare(metadata.get("audit", {}), problems)
    for key, tally in audit.tallies.items():
        problems.expect(options.allow_gaps or tally["gaps"] == 0, f"{key}: {tally['gaps']} samples lost")
    derived.compare(channels, counts, releases, is_part, problems)
    check_layout(attachments.get("foxglove-layout.json"), channels, problems)
    problems.expect(options.cut or statistics is not None, "no statistics")
    if statistics is not None:
        by_topic = {channels[i].topic: n for i, n in statistics.channel_message_counts.items()}
        problems.expect(by_topic == dict(counts), f"statistics say {by_topic}, found {dict(counts)}")
    topics = {c.topic for c in channels.values() if "layout_hash" in c.metadata}
    return counts, decoded, audit, derived, metadata.get("run", {}), topics


def check_layout(text, channels, problems):
    """The layout in the file shows topics of the file."""
    problems.expect(text, "attachment foxglove-layout.json is missing or empty")
    panels = json.loads(text)["configById"] if text else {}
    known = {channel.topic for channel in channels.values()}
    for name, panel in panels.items():
        shown = set(panel.get("topics", {})) | {p["value"].split(".")[0] for p in panel.get("paths", [])}
        problems.expect(shown <= known, f"layout: {name} shows {sorted(shown - known)}")


def check_stamps(record, channel, message, audit, problems):
    topic = channel.topic
    is_one = record.log_time == record.publish_time
    problems.expect(is_one, f"{topic}: logged at {record.log_time}, sent at {record.publish_time}")
    if "header" not in message.DESCRIPTOR.fields_by_name:
        return
    problems.expect(
        record.sequence == message.header.sequence & 0xFFFFFFFF,
        f"{topic}: record {record.sequence} holds sample {message.header.sequence}",
    )
    # Of the states a recording has some alone, so that their numbers say nothing of what is missing.
    if "layout_hash" in channel.metadata:
        audit.observe(topic, message.header, problems)


def read_through_index(data, problems):
    """The way viewers read. Returns messages per topic."""
    reader = make_reader(io.BytesIO(data), validate_crcs=True)
    summary = reader.get_summary()
    problems.expect(summary is not None and summary.chunk_indexes, "the file has no index")
    counts = Counter()
    last_ns = 0
    for _, channel, message in reader.iter_messages():
        counts[channel.topic] += 1
        problems.expect(message.log_time >= last_ns, f"{channel.topic}: index out of order")
        last_ns = message.log_time
    return counts


def verify(data, options):
    problems = Problems()
    counts, decoded, audit, derived, run, topics = read_in_file_order(data, options, problems)
    if not options.cut:
        indexed = read_through_index(data, problems)
        problems.expect(indexed == counts, f"index finds {dict(indexed)}, file holds {dict(counts)}")
    received = {topic for topic in topics if counts[topic] > 0}
    if options.expect_topics is not None:
        problems.expect(
            len(received) == options.expect_topics,
            f"{len(received)} topics with samples, expected {options.expect_topics}; "
            f"silent: {sorted(topics - received)}",
        )

    print(f"run {run.get('run_id')}: {run.get('scenario')}, seed {run.get('seed')}, {run.get('clock')}")
    for key, tally in sorted(audit.tallies.items()):
        print(f"  {key:32}", "  ".join(f"{name} {tally[name]}" for name in TALLY_KEYS))
    for topic in sorted(counts.keys() - {key.split("#")[0] for key in audit.tallies}):
        print(f"  {topic:32} count {counts[topic]}")
    for where, count in sorted(decoded.not_finite.items()):
        print(f"  note: {where} is not finite {count} times")
    share = derived.bytes[True] / max(1, sum(derived.bytes.values()))
    print(f"  {100 * share:.1f} % of all bytes before compression are for viewers")
    print(f"{sum(counts.values())} messages, {decoded.values} values, {len(received)} topics with samples")
    return problems


def chunk_spans(data):
    """Start and length of the compressed bytes of each chunk."""
    spans = []
    position = 8
    while position + 9 <= len(data) - 8:
        length = int.from_bytes(data[position + 1 : position + 9], "little")
        if data[position] == Opcode.CHUNK:
            reader = StreamReader(
                io.BytesIO(data[position : position + 9 + length]), skip_magic=True, emit_chunks=True
            )
            chunk = next(iter(reader.records))
            assert isinstance(chunk, Chunk)
            spans.append((position + 9 + length - len(chunk.data), len(chunk.data)))
        position += 9 + length
    return spans


def read_all(data, through_index):
    if through_index:
        for _ in make_reader(io.BytesIO(data), validate_crcs=True).iter_messages():
            pass
    else:
        for _ in StreamReader(io.BytesIO(data), validate_crcs=True).records:
            pass


def negative_controls(data, problems):
    """A check that accepts everything proves nothing: damaged copies must be rejected."""
    spans = chunk_spans(data)
    problems.expect(spans, "no chunk to damage")
    copies = {"cut tail": data[: len(data) - 100], "cut in half": data[: len(data) // 2]}
    for name, (start, length) in {
        "flipped bytes in the largest chunk": max(spans, key=lambda span: span[1]),
        "flipped bytes in the last chunk": spans[-1],
    }.items():
        copy = bytearray(data)
        # A single one may be a distance back into a run of equal bytes, where the next is as good.
        for place in range(start + length // 2, min(start + length // 2 + 64, start + length)):
            copy[place] ^= 0x10
        copies[name] = bytes(copy)
    for name, copy in copies.items():
        for through_index in (False, True):
            how = "index" if through_index else "file order"
            try:
                read_all(copy, through_index)
            except Exception as error:  # any refusal will do
                print(f"  rejected as it should be: {name}, {how} ({type(error).__name__})")
            else:
                problems.expect(False, f"{name}: accepted when read through {how}")


def main():
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("file", type=Path)
    parser.add_argument("--expect-topics", type=int, metavar="N", help="topics with samples")
    parser.add_argument("--allow-gaps", action="store_true", help="lost samples are no problem")
    parser.add_argument("--cut", action="store_true", help="the recorder was killed")
    parser.add_argument("--negative-controls", action="store_true", help="damaged copies too")
    options = parser.parse_args()
    data = options.file.read_bytes()
    try:
        problems = verify(data, options)
    except Exception as error:  # a reader's refusal is the finding
        problems = Problems([f"not readable: {type(error).__name__}: {error}"])
    if options.negative_controls and not problems:
        negative_controls(data, problems)
    for problem in problems:
        print(f"PROBLEM {problem}", file=sys.stderr)
    return 1 if problems else 0


if __name__ == "__main__":
    sys.exit(main())
