// SPDX-License-Identifier: BSD-3-Clause
#include "bags/mcap_writer.hpp"

#include <lz4frame.h>
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <cstring>

#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

using mcap::ByteSpan;

std::string_view as_text(ByteSpan bytes) {
  return {reinterpret_cast<const char*>(bytes.data()), bytes.size()};
}
ByteSpan as_span(std::string_view text) {
  return {reinterpret_cast<const std::byte*>(text.data()), text.size()};
}

/// A number, little endian.
template <typename Number>
std::string little(Number value) {
  std::string out(sizeof value, '\0');
  std::memcpy(out.data(), &value, sizeof value);
  if constexpr (std::endian::native == std::endian::big) std::reverse(out.begin(), out.end());
  return out;
}
/// A text, or a list, with its length before it.
std::string counted(std::string_view bytes) {
  return little(static_cast<std::uint32_t>(bytes.size())) + std::string(bytes);
}
std::string record_head(unsigned opcode, std::uint64_t length) {
  return static_cast<char>(opcode) + little(length);
}

}  // namespace

McapWriter::McapWriter(PartialFile& file, const std::string& profile, const std::string& library,
                       const std::string& compression)
    : file_(file), own_compression_(compression), zstd_(nullptr, &ZSTD_freeCCtx) {
  put({reinterpret_cast<const char*>(mcap::kMagic), mcap::kMagicSize});
  put_record(mcap::op_header, counted(profile) + counted(library));
}
McapWriter::~McapWriter() = default;

void McapWriter::put(std::string_view bytes) {
  if (in_data_) crc_.add(as_span(bytes));
  file_.write(bytes);
  offset_ += bytes.size();
}
void McapWriter::put_record(unsigned opcode, std::string_view content) {
  put(record_head(opcode, content.size()));
  put(content);
}

void McapWriter::know(unsigned opcode, ByteSpan content) {
  mcap::RecordFields fields(content);
  const std::uint16_t id = fields.id();
  auto& known = opcode == mcap::op_channel ? channels_ : schemas_;
  if (known.contains(id)) return;
  declared_ += content.size();
  if (declared_ > most_declared)
    throw InputError(file_.path(), 0, "",
                     "cannot be written: its schemas and channels are of more than 256 MB");
  Known& one = known[id];
  one.content = as_text(content);
  if (opcode == mcap::op_channel) one.schema = fields.id();
}

void McapWriter::know_channel_like(std::uint16_t id, std::uint16_t other, const std::string& topic) {
  const Known& like = channels_.at(other);
  mcap::RecordFields fields(as_span(like.content));
  fields.id(), fields.id(), fields.name();
  Known known;
  known.schema = like.schema;
  known.content = little(id) + little(like.schema) + counted(topic) + std::string(as_text(fields.rest()));
  channels_.emplace(id, std::move(known));
}

std::uint16_t McapWriter::add_topic(const Topic& topic) {
  const auto id = static_cast<std::uint16_t>(channels_.size() + 1);
  const std::string schema =
      little(id) + counted(topic.schema) + counted(topic.schema_encoding) + counted(topic.schema_text);
  const std::string channel =
      little(id) + little(id) + counted(topic.name) + counted(topic.encoding) + counted("");
  know(mcap::op_schema, as_span(schema)), know(mcap::op_channel, as_span(channel));
  return id;
}

void McapWriter::write_message(std::uint16_t id, std::uint64_t time_ns, std::string_view data) {
  const auto number = static_cast<std::uint32_t>(counts_[id]);
  write_message(id, as_span(little(number) + little(time_ns) + little(time_ns)), as_span(data));
}

void McapWriter::put_declaration(unsigned opcode, Known& known) {
  known.written = true;
  if (open_)
    chunk_ += record_head(opcode, known.content.size()), chunk_ += known.content;
  else
    put_record(opcode, known.content);
}

void McapWriter::declare(unsigned opcode, ByteSpan content) {
  know(opcode, content);
  Known& known = (opcode == mcap::op_channel ? channels_ : schemas_).at(mcap::RecordFields(content).id());
  if (known.content == as_text(content)) put_declaration(opcode, known);
}

void McapWriter::ensure_written(std::uint16_t id) {
  Known& channel = channels_.at(id);
  if (channel.written) return;
  if (const auto schema = schemas_.find(channel.schema); schema != schemas_.end() && !schema->second.written)
    put_declaration(mcap::op_schema, schema->second);
  put_declaration(mcap::op_channel, channel);
}

void McapWriter::open_chunk(const std::string& compression) {
  close_own_chunk();
  open_ = true, own_ = false, compression_ = compression;
}

void McapWriter::write_message(std::uint16_t id, ByteSpan head, ByteSpan data) {
  if (!open_) open_chunk(own_compression_), own_ = true;
  ensure_written(id);
  mcap::RecordFields fields(head);
  fields.number(4);
  const std::uint64_t time = fields.number(8);
  std::string& index = message_indexes_[id];
  if (std::uint64_t& count = counts_[id]; messages_++ == 0)
    begin_ = end_ = time, count = 1;
  else
    begin_ = std::min(begin_, time), end_ = std::max(end_, time), ++count;
  const bool is_first = index.empty() && message_indexes_.size() == 1;
  first_ = is_first ? time : std::min(first_, time), last_ = is_first ? time : std::max(last_, time);
  index += little(time) + little(std::uint64_t{chunk_.size()});
  chunk_ += record_head(mcap::op_message, 2 + head.size() + data.size()), chunk_ += little(id);
  chunk_ += as_text(head), chunk_ += as_text(data);
  if (own_ && chunk_.size() >= own_chunk) close_own_chunk();
}

std::string_view McapWriter::pack(std::string_view records) {
  if (compression_.empty()) return records;
  std::size_t size = 0;
  bool failed = true;
  if (compression_ == "lz4") {
    packed_.resize(LZ4F_compressFrameBound(records.size(), nullptr));
    size = LZ4F_compressFrame(packed_.data(), packed_.size(), records.data(), records.size(), nullptr);
    failed = LZ4F_isError(size) != 0;
  } else if (compression_ == "zstd") {
    if (!zstd_) zstd_.reset(ZSTD_createCCtx());
    packed_.resize(ZSTD_compressBound(records.size()));
    size = ZSTD_compressCCtx(zstd_.get(), packed_.data(), packed_.size(), records.data(), records.size(),
                             zstd_level);
    failed = ZSTD_isError(size) != 0;
  }
  if (failed) throw InputError(file_.path(), 0, "", "a chunk cannot be compressed by '" + compression_ + "'");
  return {packed_.data(), size};
}

void McapWriter::close_own_chunk() {
  if (open_) close_chunk();
}

void McapWriter::close_chunk(ByteSpan records, ByteSpan packed_before, bool changed) {
  open_ = false;
  if (chunk_.empty()) return;
  const std::string_view packed =
      !changed && chunk_ == as_text(records) ? as_text(packed_before) : pack(chunk_);
  if (message_indexes_.empty()) first_ = last_ = 0;
  mcap::Crc32 crc;
  crc.add(as_span(chunk_));
  const std::string times = little(first_) + little(last_), size = little(std::uint64_t{chunk_.size()}),
                    packed_size = little(std::uint64_t{packed.size()});
  const std::string head = times + size + little(crc.value()) + counted(compression_) + packed_size;
  const std::uint64_t start = offset_, length = mcap::kRecordHead + head.size() + packed.size();
  put(record_head(mcap::op_chunk, head.size() + packed.size()) + head);
  put(packed);
  std::string places;
  for (const auto& [id, entries] : message_indexes_) {
    places += little(id) + little(offset_);
    put_record(mcap::op_message_index, little(id) + counted(entries));
  }
  const std::string index = times + little(start) + little(length) + counted(places) +
                            little(offset_ - start - length) + counted(compression_) + packed_size + size;
  chunk_indexes_ += record_head(mcap::op_chunk_index, index.size()) + index;
  ++chunks_;
  chunk_.clear(), message_indexes_.clear();
}

void McapWriter::write_record(unsigned opcode, std::uint64_t length, const Bytes& bytes) {
  close_own_chunk();
  constexpr std::uint64_t piece = 256 << 10;
  const std::uint64_t start = offset_;
  put(record_head(opcode, length));
  for (std::uint64_t at = 0; at < length; at += piece)
    put(as_text(bytes(at, static_cast<std::size_t>(std::min(piece, length - at)))));
  const std::string place = little(start) + little(mcap::kRecordHead + length);
  mcap::RecordFields fields(bytes(0, static_cast<std::size_t>(std::min(piece, length))));
  if (opcode == mcap::op_attachment) {
    const std::string times{as_text(fields.take(16))};
    const std::string name = fields.name(), media_type = fields.name();
    const std::uint64_t size = fields.number(8);
    if (!fields.sound()) return;  // cannot be listed
    const std::string index = place + times + little(size) + counted(name) + counted(media_type);
    attachment_indexes_ += record_head(mcap::op_attachment_index, index.size()) + index;
    ++attachments_;
  } else if (opcode == mcap::op_metadata) {
    const std::string name = fields.name();
    if (!fields.sound()) return;
    const std::string index = place + counted(name);
    metadata_indexes_ += record_head(mcap::op_metadata_index, index.size()) + index;
    ++metadata_;
  }
}

void McapWriter::write_metadata(const std::string& name,
                                const std::vector<std::pair<std::string, std::string>>& pairs) {
  std::string map;
  for (const auto& [key, value] : pairs) map += counted(key) + counted(value);
  const std::string content = counted(name) + counted(map);
  write_record(mcap::op_metadata, content.size(), [&](std::uint64_t from, std::size_t size) {
    return as_span(content).subspan(static_cast<std::size_t>(from), size);
  });
}

void McapWriter::finish() {
  close_own_chunk();
  in_data_ = false;
  put_record(mcap::op_data_end, little(crc_.value()));
  const std::uint64_t start = offset_;
  std::string summary, offsets;
  const auto add_group = [&](unsigned opcode, const std::string& records) {
    if (records.empty()) return;
    const std::string place =
        static_cast<char>(opcode) + little(start + summary.size()) + little(std::uint64_t{records.size()});
    offsets += record_head(mcap::op_summary_offset, place.size()) + place;
    summary += records;
  };
  const auto all = [](unsigned opcode, const std::map<std::uint16_t, Known>& known) {
    std::string out;
    for (const auto& [id, one] : known) out += record_head(opcode, one.content.size()) + one.content;
    return out;
  };
  add_group(mcap::op_schema, all(mcap::op_schema, schemas_));
  add_group(mcap::op_channel, all(mcap::op_channel, channels_));
  std::string counts;
  for (const auto& [id, count] : counts_) counts += little(id) + little(count);
  const std::string statistics = little(messages_) + little(static_cast<std::uint16_t>(schemas_.size())) +
                                 little(static_cast<std::uint32_t>(channels_.size())) + little(attachments_) +
                                 little(metadata_) + little(chunks_) + little(begin_) + little(end_) +
                                 counted(counts);
  add_group(mcap::op_statistics, record_head(mcap::op_statistics, statistics.size()) + statistics);
  add_group(mcap::op_chunk_index, chunk_indexes_);
  add_group(mcap::op_attachment_index, attachment_indexes_);
  add_group(mcap::op_metadata_index, metadata_indexes_);
  const std::string footer =
      record_head(mcap::op_footer, mcap::kFooterContent) + little(start) + little(start + summary.size());
  mcap::Crc32 crc;
  for (const std::string* part : std::initializer_list<const std::string*>{&summary, &offsets, &footer})
    crc.add(as_span(*part));
  put(summary), put(offsets), put(footer), put(little(crc.value()));
  put({reinterpret_cast<const char*>(mcap::kMagic), mcap::kMagicSize});
}

}  // namespace rangecal::ingest
