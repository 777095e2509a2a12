// SPDX-License-Identifier: BSD-3-Clause
// Holds the schemas of an MCAP file against those that viewers know by name (npm's @foxglove/schemas), and its messages against its
// schemas, as JSON: what is missing or of another type, a line each.   node schemas.mjs FILE
import { open } from "node:fs/promises";
import { McapIndexedReader } from "@mcap/core";
import { loadDecompressHandlers } from "@mcap/support";
import * as known from "@foxglove/schemas/jsonschema.js";

const handle = await open(process.argv[2], "r");
const readable = {
  size: async () => BigInt((await handle.stat()).size),
  read: async (offset, length) => {
    const buffer = new Uint8Array(Number(length));
    await handle.read(buffer, 0, Number(length), Number(offset));
    return buffer;
  },
};
const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers: await loadDecompressHandlers() });
const complaints = new Set();
const text = new TextDecoder();

/// What a viewer's schema has and ours has not.
const compare = (ours, theirs, where) => {
  if (!ours) return complaints.add(`${where}: missing`);
  if (theirs.oneOf) {
    const values = (schema) => JSON.stringify(schema.oneOf?.map((one) => [one.title, one.const]));
    if (values(ours) !== values(theirs)) complaints.add(`${where}: other values`);
    return;
  }
  for (const what of ["type", "contentEncoding"])
    if (ours[what] !== theirs[what]) complaints.add(`${where}: ${what} ${ours[what]}, not ${theirs[what]}`);
  if (theirs.title === "time" || theirs.title === "duration")
    if (ours.title !== theirs.title) complaints.add(`${where}: is no ${theirs.title}`);
  const unused = ours.items && Object.keys(ours.items.properties ?? {}).length === 0 && ours.items.type === "object";
  if (theirs.items && !unused) compare(ours.items, theirs.items, `${where}[]`);
  for (const [name, schema] of Object.entries(theirs.properties ?? {})) compare(ours.properties?.[name], schema, `${where}.${name}`);
};

/// A value against its schema; every member has to be described.
const check = (value, schema, where) => {
  if (schema.oneOf) {
    if (!schema.oneOf.some((one) => one.const === value)) complaints.add(`${where}: is none of the values`);
  } else if (schema.type === "object") {
    if (typeof value !== "object" || value === null || Array.isArray(value)) return complaints.add(`${where}: is no object`);
    for (const [name, member] of Object.entries(value))
      if (schema.properties[name]) check(member, schema.properties[name], `${where}.${name}`);
      else complaints.add(`${where}.${name}: is not described`);
  } else if (schema.type === "array") {
    if (!Array.isArray(value)) return complaints.add(`${where}: is no list`);
    for (const one of value) check(one, schema.items, `${where}[]`);
  } else {
    const found = Number.isInteger(value) && schema.type === "integer" ? "integer" : typeof value;
    if (found !== schema.type) complaints.add(`${where}: ${found}, not ${schema.type}`);
  }
};

const schemas = new Map();
const seen = {};
for (const schema of reader.schemasById.values()) {
  const ours = JSON.parse(text.decode(schema.data));
  schemas.set(schema.id, ours);
  const theirs = known[schema.name.replace("foxglove.", "")];
  if (schema.name.startsWith("foxglove.")) compare(ours, theirs, schema.name);
}
for await (const message of reader.readMessages({ validateCrcs: true })) {
  const channel = reader.channelsById.get(message.channelId);
  check(JSON.parse(text.decode(message.data)), schemas.get(channel.schemaId), channel.topic);
  seen[channel.topic] = (seen[channel.topic] ?? 0) + 1;
}
console.log(JSON.stringify({ complaints: [...complaints], seen }));
await handle.close();
