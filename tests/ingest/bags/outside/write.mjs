// SPDX-License-Identifier: BSD-3-Clause
// A bag by writers that are not ours (npm's @mcap/core, @foxglove/cdr, lz4js, @foxglove/wasm-zstd): scans of a table (a line each: stamp, angle_min,
// angle_increment, n, ranges), odometry and a transform at the time of each. Beside it FILE.messages: what was written, for each message
// the length of its topic (1 byte), the topic, the log time (8, little endian), the length of its data (4) and the data.
//   node write.mjs TABLE FILE '{"scans": 40, "compression": "lz4", "chunks": true, "index": true, "bigEndian": false}'
import { open, readFile, writeFile } from "node:fs/promises";
import { McapWriter } from "@mcap/core";
import cdr from "@foxglove/cdr";
import lz4 from "lz4js";
import zstd from "@foxglove/wasm-zstd";

const [table, file, given] = process.argv.slice(2);
const options = JSON.parse(given);
await zstd.isLoaded;
const pack = { lz4: (bytes) => lz4.compress(bytes), zstd: (bytes) => zstd.compress(bytes, 3) }[options.compression];
const kind = options.bigEndian ? cdr.EncapsulationKind.CDR_BE : cdr.EncapsulationKind.CDR_LE;

const header = (out, stamp, frame) => {
  const [whole, part] = stamp.split(".");
  return out.int32(Number(whole)).uint32(Number(part.padEnd(9, "0"))).string(frame);
};
const pose = (out, at) => {
  for (const value of [at.x, at.y, 0, 0, 0, Math.sin(at.heading / 2), Math.cos(at.heading / 2)]) out.float64(value);
  return out;
};
const scan = (row) => {
  const out = header(new cdr.CdrWriter({ kind }), row.stamp, "laser");
  for (const value of [row.from, row.from + row.step * (row.ranges.length - 1), row.step, 0, 0.1, 0.05, 20]) out.float32(value);
  out.sequenceLength(row.ranges.length);
  for (const range of row.ranges) out.float32(range);
  out.sequenceLength(0); // no intensities
  return out.data;
};
const odometry = (row) => {
  const out = pose(header(new cdr.CdrWriter({ kind }), row.stamp, "odom").string("base_link"), row.at);
  for (let i = 0; i < 36 + 6 + 36; ++i) out.float64(0.01 * i);
  return out.data;
};
const transforms = (row) => {
  const out = new cdr.CdrWriter({ kind });
  out.sequenceLength(1);
  return pose(header(out, row.stamp, "odom").string("base_link"), row.at).data;
};

const number = (text) => (text === "nan" ? NaN : text === "inf" ? Infinity : Number(text));
const rows = (await readFile(table, "utf8")).split("\n").slice(1, 1 + options.scans).map((line, i) => {
  const [stamp, from, step, , ...ranges] = line.split(",");
  return { stamp, from: Number(from), step: Number(step), ranges: ranges.map(number), at: { x: 0.01 * i, y: -0.02 * i, heading: 0.05 * i } };
});

const handle = await open(file, "w");
let position = 0n;
const writer = new McapWriter({
  writable: { position: () => position, write: async (bytes) => { await handle.write(bytes); position += BigInt(bytes.byteLength); } },
  useChunks: options.chunks,
  chunkSize: 20000,
  compressChunk: pack && ((bytes) => ({ compression: options.compression, compressedData: pack(bytes) })),
  ...(options.index ? {} : { useStatistics: false, useSummaryOffsets: false, useMessageIndex: false, useChunkIndex: false, repeatSchemas: false, repeatChannels: false }),
});
await writer.start({ profile: "ros2", library: "@mcap/core" });
const topics = [];
for (const [topic, type, encode] of [["/scan", "sensor_msgs/msg/LaserScan", scan], ["/odom", "nav_msgs/msg/Odometry", odometry], ["/tf", "tf2_msgs/msg/TFMessage", transforms]]) {
  const schemaId = await writer.registerSchema({ name: type, encoding: "ros2msg", data: new TextEncoder().encode("# not read") });
  topics.push({ topic, encode, channelId: await writer.registerChannel({ schemaId, topic, messageEncoding: "cdr", metadata: new Map() }) });
}
const written = [];
for (const [sequence, row] of rows.entries())
  for (const { topic, encode, channelId } of topics) {
    const [whole, part] = row.stamp.split(".");
    const logTime = BigInt(whole) * 1000000000n + BigInt(part.padEnd(9, "0")) + 5000000n;
    const data = new Uint8Array(encode(row));
    await writer.addMessage({ channelId, sequence, logTime, publishTime: logTime, data });
    const head = Buffer.alloc(13 + topic.length);
    head.writeUInt8(topic.length, 0), head.write(topic, 1);
    head.writeBigUInt64LE(logTime, 1 + topic.length), head.writeUInt32LE(data.length, 9 + topic.length);
    written.push(head, Buffer.from(data));
  }
await writer.end();
await handle.close();
await writeFile(file + ".messages", Buffer.concat(written));
