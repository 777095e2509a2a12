// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>

#include "bags/message_source.hpp"

namespace rangecal::ingest {

/// Who takes every record of an MCAP file, to copy it. A content is what follows opcode and length; spans hold until the call returns.
class McapSink {
 public:
  using Bytes = std::function<std::span<const std::byte>(std::uint64_t from, std::size_t size)>;

  virtual ~McapSink() = default;
  /// Of the summary, before all others: a schema or channel that may be declared in its place later, or where that is lost not at all.
  virtual void known(unsigned opcode, std::span<const std::byte> content) = 0;
  /// A schema or channel in its place.
  virtual void declared(unsigned opcode, std::span<const std::byte> content) = 0;
  virtual void message(const BagTopic& topic, std::span<const std::byte> content) = 0;
  /// What follows until chunk_ends is of one chunk.
  virtual void chunk_begins(const std::string& compression) = 0;
  /// Its records as they stood in the file, and compressed; both empty where its end is missing.
  virtual void chunk_ends(std::span<const std::byte> records, std::span<const std::byte> packed) = 0;
  /// The header, an attachment, metadata, or a record of an opcode that is left to others: of any length, in pieces.
  virtual void other(unsigned opcode, std::uint64_t length, const Bytes& bytes) = 0;
};

class McapFile : public MessageSource {
 public:
  /// Everything that can be read, in the order of the file, but for what has to be made anew: indexes, summary and end.
  virtual void copy(McapSink& sink, const Progress& progress) = 0;
  /// Whether the file declares a channel `id`, once topics() has been asked for.
  virtual bool has_channel(std::uint16_t id) const = 0;
};

/// An MCAP file, by the MCAP format specification (mcap.dev/spec; the section is in brackets). All numbers are little endian, a
/// text is its length in 4 bytes and its bytes [Serialization].
///
///   89 'M' 'C' 'A' 'P' '0' CR LF, records, the same eight bytes  [File Structure]
///   record:   opcode (1 byte), length of the content (8), content  [Records]
///   Header    01
///   Footer    02  summary_start (8), summary_offset_start (8), summary_crc (4): of all from summary_start to here
///   Schema    03  id (2), name, encoding, data
///   Channel   04  id (2), schema_id (2), topic, message_encoding, metadata
///   Message   05  channel_id (2), sequence (4), log_time (8, ns), publish_time (8), data
///   Chunk     06  first and last log_time (8 each), uncompressed_size (8), uncompressed_crc (4), compression ("", "lz4": its frame
///                 format, "zstd"), length (8) and records, which are schemas, channels and messages
///   Index     08  of a chunk: first and last log_time, chunk_start_offset, chunk_length (8 each), channels (4 + 10 each: id and an offset), ...
///   Counts    0b  Statistics: message_count (8), schema_count (2), channel_count, attachment_count, metadata_count, chunk_count (4
///                 each), first and last log_time (8 each), messages of each channel (4 + 10 each: id and count)
///   Data End  0f  data_section_crc (4): of all before this record
///   others are skipped; a CRC (CRC-32 of IEEE 802.3) of 0 is none.
///
/// What is trusted: a message of a chunk whose CRC holds; a message outside of chunks, or of a chunk without CRC, if the CRC of
/// the data section holds, and if there is none. What fails its CRC is left out. The summary is used only if its own
/// CRC holds: it then says where chunks are, so that those without a wanted topic are not read, and damage between chunks loses
/// no more than one. Without it the file is read from its start to where it can be read no further.
std::unique_ptr<McapFile> open_mcap(const std::string& path);

}  // namespace rangecal::ingest
