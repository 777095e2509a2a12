// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "bags/bag_copy.hpp"
#include "bags/mcap_source.hpp"
#include "bags/mcap_writer.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/version.hpp"

namespace rangecal::ingest {
namespace {

class McapCopy : public McapSink {
 public:
  /// `source` has told its topics where raw messages are kept.
  McapCopy(const std::string& from, const McapFile& source, PartialFile& file, const BagChange& change)
      : from_(from), source_(source), file_(file), change_(change) {}

  void known(unsigned opcode, mcap::ByteSpan content) override {
    before_header_.emplace_back(opcode,
                                std::string(reinterpret_cast<const char*>(content.data()), content.size()));
  }

  void declared(unsigned opcode, mcap::ByteSpan content) override { writer().declare(opcode, content); }

  void chunk_begins(const std::string& compression) override {
    writer().open_chunk(compression);
    changed_ = false;
  }
  void chunk_ends(mcap::ByteSpan records, mcap::ByteSpan packed) override {
    writer().close_chunk(records, packed, changed_ || packed.empty());
  }

  void message(const BagTopic& topic, mcap::ByteSpan content) override {
    mcap::RecordFields fields(content);
    const std::uint16_t id = fields.id();
    const mcap::ByteSpan head = fields.take(20), data = fields.rest();
    if (!writer().knows_channel(id)) return;  // of a declaration that could not be copied
    if (topic.name != change_.topic) return writer().write_message(id, head, data);
    changed_ = true;
    mcap::RecordFields times(head);
    times.number(4);
    const auto time = static_cast<std::int64_t>(times.number(8));
    if (const auto changed = change_.change({topic, time, data})) writer().write_message(id, head, *changed);
    if (!change_.keep_raw.empty()) writer().write_message(raw_channel(id), head, data);
  }

  void other(unsigned opcode, std::uint64_t length, const Bytes& bytes) override {
    if (opcode == mcap::op_header) {
      mcap::RecordFields fields(bytes(0, static_cast<std::size_t>(std::min<std::uint64_t>(length, 65536))));
      start(fields.name());
      return;
    }
    if (opcode == mcap::op_metadata) refuse_a_second_correction(length, bytes);
    writer().write_record(opcode, length, bytes);
  }

  void finish() {
    writer().write_metadata(kNoteName, change_.note());
    writer().finish();
  }

 private:
  void start(const std::string& profile) {
    if (writer_) return;
    writer_ = std::make_unique<McapWriter>(file_, profile, "rangecal " + std::string(version()));
    for (const auto& [opcode, content] : before_header_)
      writer_->know(opcode, {reinterpret_cast<const std::byte*>(content.data()), content.size()});
    before_header_.clear();
  }
  McapWriter& writer() {
    start("");  // where the header is damaged
    return *writer_;
  }

  /// The channel of the messages as they were, beside the channel `id`.
  std::uint16_t raw_channel(std::uint16_t id) {
    if (const auto found = raw_.find(id); found != raw_.end()) return found->second;
    std::uint16_t free = 0xffff;
    while (source_.has_channel(free) || writer().knows_channel(free))
      if (free-- == 0)
        throw InputError(from_, 0, "", "declares 65536 channels: none is left for " + change_.keep_raw);
    writer().know_channel_like(free, id, change_.keep_raw);
    return raw_[id] = free;
  }

  void refuse_a_second_correction(std::uint64_t length, const Bytes& bytes) const {
    mcap::RecordFields fields(bytes(0, static_cast<std::size_t>(std::min<std::uint64_t>(length, 65536))));
    if (fields.name() != kNoteName) return;
    mcap::RecordFields pairs(fields.take(std::min<std::uint64_t>(fields.number(4), fields.rest().size())));
    while (pairs.sound() && !pairs.rest().empty()) {
      const std::string key = pairs.name();
      if (pairs.name() == change_.topic && key == "topic")
        throw InputError(from_, 0, "",
                         "its " + change_.topic + " is corrected already, as its metadata says");
    }
  }

  std::string from_;
  const McapFile& source_;
  PartialFile& file_;
  const BagChange& change_;
  std::unique_ptr<McapWriter> writer_;
  std::vector<std::pair<unsigned, std::string>> before_header_;
  std::map<std::uint16_t, std::uint16_t> raw_;
  bool changed_ = false;
};

}  // namespace

BagCopied copy_mcap(const std::string& from, const std::string& to, const BagChange& change,
                    const MessageSource::Progress& progress) {
  const std::unique_ptr<McapFile> source = open_mcap(from);
  if (!change.keep_raw.empty()) source->topics();  // for a channel that none of the file's is
  PartialFile file(to);
  McapCopy copy(from, *source, file, change);
  source->copy(copy, progress);
  copy.finish();
  file.put_in_place();
  return {source->losses(), source->format()};
}

}  // namespace rangecal::ingest
