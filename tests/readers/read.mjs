// Reads MCAP files whole, by their index and as streams, checks all checksums, and prints what is in them as JSON.

import { createHash } from "node:crypto";
import { open, readFile } from "node:fs/promises";
import { argv, stdout } from "node:process";
import lz4 from "@foxglove/wasm-lz4";
import zstd from "@foxglove/wasm-zstd";
import { McapIndexedReader, McapStreamReader } from "@mcap/core";

await Promise.all([lz4.isLoaded, zstd.isLoaded]);
const decompressHandlers = {
  lz4: (data, size) => lz4(data, Number(size)),
  zstd: (data, size) => zstd.decompress(data, Number(size)),
};

const sha256 = (data) => createHash("sha256").update(data).digest("hex");

class Contents {
  topics = {};
  attachments = [];
  metadata = [];

  constructor(profile) {
    this.profile = profile;
  }

  message(message, channel) {
    const { logTime, publishTime, sequence, data } = message;
    const line = `${logTime} ${publishTime} ${sequence} ${sha256(data)}`;
    (this.topics[channel.topic] ??= []).push(line);
  }

  attachment({ name, mediaType, logTime, createTime, data }) {
    this.attachments.push([name, mediaType, `${logTime}`, `${createTime}`, sha256(data)]);
  }

  metadatum({ name, metadata }) {
    this.metadata.push([name, Object.fromEntries(metadata)]);
  }
}

async function byIndex(path) {
  const file = await open(path);
  const readable = {
    size: async () => BigInt((await file.stat()).size),
    read: async (offset, length) => {
      const { bytesRead, buffer } = await file.read(new Uint8Array(Number(length)), 0, Number(length), Number(offset));
      if (bytesRead !== Number(length)) throw new Error(`${bytesRead} bytes instead of ${length} at ${offset}`);
      return buffer;
    },
  };
  const reader = await McapIndexedReader.Initialize({ readable, decompressHandlers });
  const found = new Contents(reader.header.profile);
  for await (const message of reader.readMessages({ validateCrcs: true })) {
    found.message(message, reader.channelsById.get(message.channelId));
  }
  for await (const attachment of reader.readAttachments({ validateCrcs: true })) found.attachment(attachment);
  for await (const metadata of reader.readMetadata()) found.metadatum(metadata);
  found.announced = Number(reader.statistics.messageCount);
  await file.close();
  return found;
}

async function asStream(path) {
  const data = await readFile(path);
  const reader = new McapStreamReader({ decompressHandlers, validateCrcs: true });
  const channels = new Map();
  let found;
  const kinds = {
    Header: (record) => (found = new Contents(record.profile)),
    Channel: (record) => channels.set(record.id, record),
    Message: (record) => found.message(record, channels.get(record.channelId)),
    Attachment: (record) => found.attachment(record),
    Metadata: (record) => found.metadatum(record),
  };
  for (let at = 0; at < data.length; at += 65536) {
    reader.append(data.subarray(at, at + 65536));
    for (let record; (record = reader.nextRecord()); ) kinds[record.type]?.(record);
  }
  if (!reader.done() || reader.bytesRemaining() !== 0) throw new Error("the file ends early");
  return found;
}

const results = [];
for (const path of argv.slice(2)) results.push({ indexed: await byIndex(path), streamed: await asStream(path) });
stdout.write(JSON.stringify(results));
