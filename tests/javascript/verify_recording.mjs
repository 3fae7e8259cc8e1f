// Checks a recording with the JavaScript libraries that viewers read it with.
//
//     node verify_recording.mjs FILE
//
// Reads the file through its index, decodes every message of every topic from the schemas in the file
// alone, compares the counts with the recorder's audit and the file's statistics, and prints the totals. A
// file with the metadata of a recovered recording needs no summary.
// Exit code 0: no problem; 1: problems; 2: wrong usage.

import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { FileHandleReadable } from "@mcap/nodejs";
import { loadDecompressHandlers } from "@mcap/support";
import { end, expect, typeOf, walk } from "./checks.mjs";

async function verify(path) {
  const reader = await McapIndexedReader.Initialize({
    readable: new FileHandleReadable(await open(path, "r")),
    decompressHandlers: await loadDecompressHandlers(),
  });
  const types = new Map();
  const counts = new Map();
  const samples = new Map();
  let values = 0;
  for await (const message of reader.readMessages()) {
    const channel = reader.channelsById.get(message.channelId);
    const schema = reader.schemasById.get(channel.schemaId);
    if (!types.has(channel.id)) {
      types.set(channel.id, typeOf(schema.name, schema.data));
    }
    const type = types.get(channel.id);
    const decoded = type.decode(message.data);
    values += walk(decoded, type, channel.topic);
    counts.set(channel.topic, (counts.get(channel.topic) ?? 0) + 1);
    // Of the states a recording has some alone, so that no audit counts them.
    if (type.fields.header && channel.metadata.has("layout_hash")) {
      const seat = `${channel.topic}#${decoded.header.seat ?? 0}`;
      samples.set(seat, (samples.get(seat) ?? 0) + 1);
    }
  }

  const metadata = new Map();
  for await (const record of reader.readMetadata()) {
    metadata.set(record.name, record.metadata);
  }
  const attachments = new Map();
  for await (const record of reader.readAttachments()) {
    attachments.set(record.name, record.data);
  }
  const audit = metadata.get("audit") ?? new Map();
  expect(audit.size === samples.size, `the audit covers ${audit.size} seats, found ${samples.size}`);
  for (const [seat, count] of samples) {
    const entry = JSON.parse(audit.get(seat) ?? "{}");
    expect(entry.count === count, `${seat}: ${count} samples, the audit says ${entry.count}`);
    expect(entry.gaps === 0, `${seat}: ${entry.gaps} samples lost`);
  }
  for (const [id, count] of reader.statistics.channelMessageCounts) {
    const { topic } = reader.channelsById.get(id);
    const found = counts.get(topic) ?? 0;
    expect(found === Number(count), `${topic}: ${found} messages, statistics say ${count}`);
  }
  expect(attachments.has("scenario.toml"), "attachment scenario.toml is missing");
  const layout = JSON.parse(new TextDecoder().decode(attachments.get("foxglove-layout.json")));
  expect(Object.keys(layout.configById).length > 0, "the layout has no panels");
  const isRecovered = metadata.get("recovered")?.has("from") ?? false;
  expect(isRecovered || metadata.get("summary")?.size > 0, "metadata summary is missing");
  const messages = [...counts.values()].reduce((sum, count) => sum + count, 0);
  console.log(`${path}: ${messages} messages, ${values} values, ${counts.size} topics`);
}

const [path, ...rest] = process.argv.slice(2);
if (path == null || rest.length > 0) {
  console.error("usage: node verify_recording.mjs FILE");
  process.exit(2);
}
try {
  await verify(path);
} catch (error) {
  expect(false, `not readable: ${error.name}: ${error.message}`);
}
end();
