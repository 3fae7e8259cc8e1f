// A client of a live flight that shares no code with its server: the libraries that viewers connect with.
//
//     node live_client.mjs ws://127.0.0.1:8765 [--for SECONDS | --stall]
//
// Subscribes to every channel and decodes every message from the schemas that the server advertises alone,
// until the flight ends or for so many seconds; checks that time and sequence numbers go forward and that
// nothing can be published, called or set; prints what came on each topic. With --stall it subscribes and
// never reads again, until it is ended.
// Exit code 0: no problem; 1: problems; 2: wrong usage.

import FoxgloveProtocol from "@foxglove/ws-protocol";
import { WebSocket } from "ws";
import { end, expect, typeOf, walk } from "./checks.mjs";

const { FoxgloveClient } = FoxgloveProtocol;
/** Of the servers of today; its messages are those of the protocol before. */
const SUBPROTOCOL = "foxglove.sdk.v1";
const PATIENCE_MS = 20_000;

/** Resolves with the first event of a kind for which `holds`. */
function once(client, name, holds = () => true) {
  return new Promise((resolve, reject) => {
    const timer = setTimeout(() => reject(new Error(`no ${name} within ${PATIENCE_MS / 1000} s`)), PATIENCE_MS);
    const listen = (event) => {
      if (holds(event)) {
        clearTimeout(timer);
        client.off(name, listen);
        resolve(event);
      }
    };
    client.on(name, listen);
  });
}

function connect(url) {
  const socket = new WebSocket(url, [SUBPROTOCOL]);
  const client = new FoxgloveClient({ ws: socket });
  client.on("error", (error) => {
    console.error(`PROBLEM ${error.message}`);
    process.exit(1);
  });
  return { socket, client };
}

/** Checks the channels, messages and time that the server sends as they arrive. */
class Channels {
  constructor(client) {
    this.client = client;
    this.bySubscription = new Map();
    this.clock = 0n;
    client.on("time", ({ timestamp }) => {
      expect(timestamp > this.clock, `the flight's time goes from ${this.clock} to ${timestamp}`);
      this.clock = timestamp;
    });
    client.on("advertise", (channels) => channels.forEach((channel) => this.add(channel)));
    client.on("message", (message) => this.take(message));
  }

  add(channel) {
    const { id, topic, encoding, schemaEncoding, schemaName, schema } = channel;
    expect(encoding === "protobuf", `${topic}: encoded as ${encoding}`);
    expect((schemaEncoding ?? "protobuf") === "protobuf", `${topic}: schema in ${schemaEncoding}`);
    const type = typeOf(schemaName, Buffer.from(schema, "base64"));
    const seen = { topic, type, count: 0, values: 0, times: new Map(), sequences: new Map() };
    this.bySubscription.set(this.client.subscribe(id), seen);
  }

  take({ subscriptionId, timestamp, data }) {
    const seen = this.bySubscription.get(subscriptionId);
    if (seen == null) {
      expect(false, `a message for subscription ${subscriptionId}, which is none`);
      return;
    }
    const message = seen.type.decode(new Uint8Array(data.buffer, data.byteOffset, data.byteLength));
    seen.values += walk(message, seen.type, seen.topic);
    seen.count += 1;
    // What several loops write comes from each in its order; one may be a step ahead of another.
    const writer = seen.type.fields.header ? message.header.seat : 0;
    const time = seen.times.get(writer) ?? 0n;
    expect(timestamp >= time, `${seen.topic}#${writer}: time goes back from ${time} to ${timestamp}`);
    seen.times.set(writer, timestamp);
    if (seen.type.fields.header) {
      const { seat, sequence } = message.header;
      const [before, now] = [seen.sequences.get(seat) ?? -1n, BigInt(sequence.toString())];
      expect(now > before, `${seen.topic}#${seat}: sequence goes from ${before} to ${now}`);
      seen.sequences.set(seat, now);
    }
  }
}

/** A client that may only read gets an error for each attempt to write, and stays connected. */
async function isReadOnly(client, info) {
  for (const write of ["clientPublish", "parameters", "services", "assets", "playbackControl"]) {
    expect(!info.capabilities.includes(write), `the server offers ${write}`);
  }
  const refused = once(client, "status", ({ level }) => level === 2);
  const channel = client.advertise({ topic: "/goto", encoding: "json", schemaName: "goto" });
  expect(/clientPublish/.test((await refused).message), "publishing is refused with other words");
  client.sendMessage(channel, new TextEncoder().encode("{}"));
  const set = once(client, "status", ({ level, message }) => level === 2 && /parameters/.test(message));
  client.setParameters([{ name: "seed", value: 1 }]);
  await set;
  const failed = once(client, "serviceCallFailure");
  client.sendServiceCallRequest({ serviceId: 1, callId: 1, encoding: "json", data: new DataView(new ArrayBuffer(2)) });
  await failed;
}

async function follow(url, seconds) {
  const { socket, client } = connect(url);
  const channels = new Channels(client);
  const closed = new Promise((resolve) => client.on("close", resolve));
  const info = await once(client, "serverInfo");
  expect(socket.protocol === SUBPROTOCOL, `the server speaks ${socket.protocol}`);
  await once(client, "message");
  await isReadOnly(client, info);
  const counted = [...channels.bySubscription.values()].reduce((sum, seen) => sum + seen.count, 0);
  const long = new Promise((resolve) => { if (seconds != null) setTimeout(resolve, seconds * 1000); });
  await Promise.race([closed, long]);
  const all = [...channels.bySubscription.values()].sort((a, b) => a.topic.localeCompare(b.topic));
  const messages = all.reduce((sum, seen) => sum + seen.count, 0);
  expect(messages > counted, "nothing came after what was refused");
  const times = all.flatMap((seen) => [...seen.times.values()]);
  const latest = times.reduce((latest, time) => (time > latest ? time : latest), 0n);
  // Viewers go by this clock, or else by their own.
  const behind = latest - channels.clock;
  expect(behind < 1_000_000_000n, `the flight's clock is ${behind} ns behind its samples`);
  expect(all.some(({ topic, count }) => topic.endsWith("truth") && count > 0), "the vehicle's motion did not come");
  for (const { topic, type, count, values } of all) {
    console.log(`${topic.padEnd(28)} ${String(count).padStart(7)} messages ${String(values).padStart(9)} values  ${type.fullName.slice(1)}`);
  }
  console.log(`${info.name}: ${messages} messages on ${all.filter(({ count }) => count > 0).length} of ${all.length} channels`);
  end();
}

async function stall(url) {
  const { socket, client } = connect(url);
  const channels = new Channels(client);
  await once(client, "message");
  socket.pause();
  console.log(`subscribed to ${channels.bySubscription.size} channels, reads no more`);
  // A paused socket alone does not keep the process alive for certain.
  setInterval(() => {}, 60_000);
}

const [url, mode, seconds, ...rest] = process.argv.slice(2);
const isUsed = url?.startsWith("ws://") && rest.length === 0
  && (mode == null || (mode === "--stall" && seconds == null) || (mode === "--for" && Number(seconds) > 0));
if (!isUsed) {
  console.error("usage: node live_client.mjs ws://HOST:PORT [--for SECONDS | --stall]");
  process.exit(2);
}
try {
  await (mode === "--stall" ? stall(url) : follow(url, seconds));
} catch (error) {
  console.error(`PROBLEM ${error.name}: ${error.message}`);
  process.exit(1);
}
