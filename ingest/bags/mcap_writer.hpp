// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <map>
#include <memory>
#include <set>
#include <span>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "bags/mcap_records.hpp"
#include "rangecal/core/files.hpp"

struct ZSTD_CCtx_s;

namespace rangecal::ingest {

/// Writes an MCAP file (mcap_source.hpp says which records there are) whole: chunks with checksums, an index of messages behind each,
/// and at the end the statistics, the indexes of chunks, attachments and metadata, the offsets of these groups, and checksums of data and
/// summary. Memory is that of one chunk and of the indexes, some 100 bytes a chunk and 10 for each of its topics.
class McapWriter {
 public:
  /// Zstandard at its fastest level: a chunk of scans becomes no smaller at those above.
  static constexpr int zstd_level = 1;
  /// A chunk that nobody closes is closed at this size.
  static constexpr std::size_t own_chunk = std::size_t{1} << 20;
  /// Of all schemas and channels, which are held to the end.
  static constexpr std::size_t most_declared = std::size_t{256} << 20;

  /// `file` must outlive this. `compression` is that of chunks which nobody opened: of messages outside of chunks.
  McapWriter(PartialFile& file, const std::string& profile, const std::string& library,
             const std::string& compression = "");
  ~McapWriter();

  /// The content of a schema or channel, to be written where a message needs it first; the first of an id counts.
  void know(unsigned opcode, mcap::ByteSpan content);
  bool knows_channel(std::uint16_t id) const { return channels_.contains(id); }
  /// The content of the known channel under another id and topic.
  void know_channel_like(std::uint16_t id, std::uint16_t other, const std::string& topic);
  /// Writes a schema or channel here, if it is the one that is known of its id.
  void declare(unsigned opcode, mcap::ByteSpan content);

  /// What a topic of one's own is made of; returns the id of its channel.
  struct Topic {
    std::string name, encoding;                        ///< of its messages
    std::string schema, schema_encoding, schema_text;  ///< name, kind and text of what describes them
  };
  std::uint16_t add_topic(const Topic& topic);
  /// A message of a topic of one's own, numbered from 0 within it.
  void write_message(std::uint16_t id, std::uint64_t time_ns, std::string_view data);

  /// `compression`: "", "lz4" or "zstd". Messages outside of chunks come into chunks of `own_chunk`.
  void open_chunk(const std::string& compression);
  /// A message's record of the known channel `id`: `head` is the 20 bytes behind the id: sequence and both times.
  void write_message(std::uint16_t id, mcap::ByteSpan head, mcap::ByteSpan data);
  /// `records` and `packed`: a chunk as it was read, of which `packed` is kept where nothing in it was changed.
  void close_chunk(mcap::ByteSpan records = {}, mcap::ByteSpan packed = {}, bool changed = true);

  using Bytes = std::function<mcap::ByteSpan(std::uint64_t from, std::size_t size)>;
  /// An attachment, metadata, or a record of an opcode that is left to others.
  void write_record(unsigned opcode, std::uint64_t length, const Bytes& bytes);
  void write_metadata(const std::string& name, const std::vector<std::pair<std::string, std::string>>& pairs);
  /// Summary and end.
  void finish();

 private:
  struct Known {
    std::string content;
    std::uint16_t schema = 0;  ///< of a channel
    bool written = false;
  };
  void ensure_written(std::uint16_t channel);
  void put_declaration(unsigned opcode, Known& known);
  void close_own_chunk();
  std::string_view pack(std::string_view records);
  void put(std::string_view bytes);
  void put_record(unsigned opcode, std::string_view content);

  PartialFile& file_;
  mcap::Crc32 crc_;
  bool in_data_ = true;
  std::uint64_t offset_ = 0;
  std::map<std::uint16_t, Known> schemas_, channels_;
  std::size_t declared_ = 0;

  bool open_ = false, own_ = false;
  std::string own_compression_, compression_, chunk_, packed_;
  std::uint64_t first_ = 0, last_ = 0;
  std::map<std::uint16_t, std::string> message_indexes_;  ///< of the chunk: entries of time and offset

  std::string chunk_indexes_, attachment_indexes_, metadata_indexes_;
  std::uint32_t chunks_ = 0, attachments_ = 0, metadata_ = 0;
  std::uint64_t messages_ = 0, begin_ = 0, end_ = 0;
  std::map<std::uint16_t, std::uint64_t> counts_;
  std::unique_ptr<ZSTD_CCtx_s, std::size_t (*)(ZSTD_CCtx_s*)> zstd_;
};

}  // namespace rangecal::ingest
