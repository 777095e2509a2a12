// SPDX-License-Identifier: BSD-3-Clause
// What readers that are not ours (npm's @mcap/core) find in an MCAP file, as JSON: by its index, and once more from start to end. Fails where a
// checksum does.   node read.mjs FILE
import { open } from "node:fs/promises";
import { createHash } from "node:crypto";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";

const handle = await open(process.argv[2], "r");
const size = (await handle.stat()).size;
const decompressHandlers = await loadDecompressHandlers();
const readable = {
  size: async () => BigInt(size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await handle.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const hash = (bytes) => createHash("sha256").update(bytes).digest("hex");
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
const topics = {};
const add = (into, topic, message) => {
  into[topic] ??= { messages: 0, digest: createHash("sha256") };
  into[topic].messages += 1;
  into[topic].digest.update(`${message.sequence} ${message.logTime} ${message.publishTime} ${hash(message.data)}\n`);
};
for await (const message of reader.readMessages({ validateCrcs: true }))
  add(topics, reader.channelsById.get(message.channelId).topic, message);
const metadata = [];
for await (const one of reader.readMetadata()) metadata.push([one.name, Object.fromEntries(one.metadata)]);
const attachments = [];
for await (const one of reader.readAttachments({ validateCrcs: true })) attachments.push([one.name, one.data.length, hash(one.data)]);

const streamed = {};
const channels = new Map();
const stream = new McapStreamReader({ decompressHandlers, validateCrcs: true });
for (let at = 0; at < size; at += 1 << 20) {
  stream.append(await readable.read(BigInt(at), BigInt(Math.min(1 << 20, size - at))));
  for (let record; (record = stream.nextRecord()); ) {
    if (record.type === "Channel") channels.set(record.id, record.topic);
    if (record.type === "Message") add(streamed, channels.get(record.channelId), record);
  }
}
if (!stream.done()) throw new Error("the stream does not end");
const told = (of) =>
  Object.fromEntries(Object.entries(of).sort().map(([topic, one]) => [topic, { messages: one.messages, digest: one.digest.digest("hex") }]));
const statistics = reader.statistics;
console.log(
  JSON.stringify(
    {
      profile: reader.header.profile,
      topics: told(topics),
      streamed: told(streamed),
      messages: Number(statistics.messageCount),
      counts: Object.fromEntries([...statistics.channelMessageCounts].map(([id, n]) => [reader.channelsById.get(id).topic, Number(n)])),
      schemas: [...reader.schemasById.values()].map((s) => [s.name, s.encoding, hash(s.data)]),
      channels: [...reader.channelsById.values()].map((c) => [c.topic, c.messageEncoding, Object.fromEntries(c.metadata)]),
      chunks: reader.chunkIndexes.map((c) => c.compression),
      groups: [...reader.summaryOffsetsByOpcode.keys()],
      metadata,
      attachments,
      dataSectionCrc: reader.dataSectionCrc ?? null,
    },
    null,
    1,
  ),
);
await handle.close();
