// SPDX-License-Identifier: BSD-3-Clause
#include "bags/mcap_source.hpp"

#include <fcntl.h>
#include <fmt/core.h>
#include <lz4frame.h>
#include <sys/stat.h>
#include <unistd.h>
#include <zstd.h>

#include <algorithm>
#include <cerrno>
#include <cstring>
#include <map>
#include <optional>
#include <utility>

#include "bags/mcap_records.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

using namespace mcap;

constexpr std::uint64_t kLargestChunk = std::uint64_t{512} << 20, kLargestMessage = std::uint64_t{512} << 20;
constexpr ByteSpan::size_type kWindow = std::size_t{256} << 10, kGlance = 4096;

/// Bytes that grow without being filled: what a damaged file announces costs no memory before it is there.
class Buffer {
 public:
  std::byte* of_size(std::size_t size) {
    if (size > capacity_) bytes_ = std::make_unique_for_overwrite<std::byte[]>(size), capacity_ = size;
    return bytes_.get();
  }
  std::byte* data() { return bytes_.get(); }
  std::size_t capacity() const { return capacity_; }

 private:
  std::unique_ptr<std::byte[]> bytes_;
  std::size_t capacity_ = 0;
};

/// A file of any length, seen through a window that moves mostly forward.
class FileWindow {
 public:
  explicit FileWindow(const std::string& path)
      : path_(path), file_(::open(path.c_str(), O_RDONLY | O_CLOEXEC)) {
    struct stat facts {};
    if (file_ < 0 || ::fstat(file_, &facts) != 0) fail();
    size_ = static_cast<std::uint64_t>(facts.st_size);
  }
  FileWindow(const FileWindow&) = delete;
  FileWindow& operator=(const FileWindow&) = delete;
  ~FileWindow() { ::close(file_); }

  std::uint64_t size() const { return size_; }
  /// The bytes from `offset` on, which have to be within the file; valid until the next call.
  ByteSpan view(std::uint64_t offset, std::size_t size) {
    if (offset >= start_ && offset + size <= start_ + filled_)
      return {buffer_.data() + (offset - start_), size};
    const bool onward = offset >= start_ && offset <= start_ + filled_;
    const std::size_t kept = onward ? start_ + filled_ - offset : 0;
    const std::size_t wanted =
        std::min<std::uint64_t>(std::max(size, onward ? kWindow : kGlance), size_ - offset);
    if (wanted > buffer_.capacity()) {
      Buffer larger;
      std::byte* bytes = larger.of_size(std::max(wanted, kWindow));
      if (kept > 0) std::memcpy(bytes, buffer_.data() + (offset - start_), kept);
      buffer_ = std::move(larger);
    } else if (kept > 0) {
      std::memmove(buffer_.data(), buffer_.data() + (offset - start_), kept);
    }
    start_ = offset, filled_ = kept;
    while (filled_ < wanted) {
      const ssize_t count =
          ::pread(file_, buffer_.data() + filled_, wanted - filled_, static_cast<off_t>(start_ + filled_));
      if (count < 0 && errno == EINTR) continue;
      if (count < 0) fail();
      if (count == 0) throw InputError(path_, 0, "", "became shorter while it was read");
      filled_ += static_cast<std::size_t>(count);
    }
    return {buffer_.data(), size};
  }

 private:
  [[noreturn]] void fail() {
    const std::string why = std::strerror(errno);
    if (file_ >= 0) ::close(file_), file_ = -1;
    throw InputError(path_, 0, "", "cannot be read: " + why);
  }

  std::string path_;
  int file_;
  std::uint64_t size_ = 0, start_ = 0;
  std::size_t filled_ = 0;
  Buffer buffer_;
};

/// What decompresses the chunks of a file, one after the other.
class Decompressor {
 public:
  /// The `size` bytes that `packed` holds by `compression`; nothing where it does not.
  std::optional<ByteSpan> unpack(const std::string& compression, ByteSpan packed, std::uint64_t size) {
    if (compression.empty()) return packed.size() == size ? std::optional(packed) : std::nullopt;
    if (size > kLargestChunk) return std::nullopt;
    std::byte* out = buffer_.of_size(std::max<std::size_t>(size, 1));
    if (compression == "zstd" ? !zstd(packed, out, size) : compression != "lz4" || !lz4(packed, out, size))
      return std::nullopt;
    return ByteSpan(out, size);
  }

 private:
  bool zstd(ByteSpan packed, std::byte* out, std::size_t size) {
    if (!zstd_) zstd_.reset(ZSTD_createDCtx());
    return ZSTD_decompressDCtx(zstd_.get(), out, size, packed.data(), packed.size()) == size;
  }
  bool lz4(ByteSpan packed, std::byte* out, std::size_t size) {
    if (LZ4F_dctx* context = nullptr; !lz4_) {
      if (LZ4F_isError(LZ4F_createDecompressionContext(&context, LZ4F_VERSION))) return false;
      lz4_.reset(context);
    }
    LZ4F_resetDecompressionContext(lz4_.get());
    std::size_t written = 0, hint = 1;
    while (!packed.empty()) {
      std::size_t to = size - written, from = packed.size();
      hint = LZ4F_decompress(lz4_.get(), out + written, &to, packed.data(), &from, nullptr);
      if (LZ4F_isError(hint) || (to == 0 && from == 0)) return false;
      written += to, packed = packed.subspan(from);
    }
    return hint == 0 && written == size;
  }

  std::unique_ptr<ZSTD_DCtx, decltype(&ZSTD_freeDCtx)> zstd_{nullptr, &ZSTD_freeDCtx};
  std::unique_ptr<LZ4F_dctx, decltype(&LZ4F_freeDecompressionContext)> lz4_{nullptr,
                                                                            &LZ4F_freeDecompressionContext};
  Buffer buffer_;
};

class McapSource : public McapFile {
 public:
  explicit McapSource(const std::string& path) : path_(path), file_(path) {
    if (file_.size() < kMagicSize || !is_magic(0))
      throw InputError(path, 0, "", "is no MCAP file of version 0");
    read_footer();
    summary_holds_ = read_summary();
    if (!summary_holds_)
      schemas_.clear(), channels_.clear(), counts_.clear(), chunks_.clear(), indexed_ = false;
  }

  std::vector<BagTopic> topics() override {
    std::map<std::uint16_t, std::uint64_t> counts = counts_;
    if (counts.empty())
      walk(
          {}, [&](Channel& channel, const BagMessage&) { ++counts[channel.id]; }, {}, true);
    std::vector<BagTopic> topics;
    for (const auto& [id, channel] : channels_) {
      topics.push_back(channel.topic);
      topics.back().messages = counts.contains(id) ? counts.at(id) : 0;
    }
    return merged(std::move(topics));
  }

  void read(const std::vector<std::string>& names, const Take& take, const Progress& progress) override {
    walk(
        names, [&](Channel&, const BagMessage& message) { take(message); }, progress, false);
  }

  void copy(McapSink& sink, const Progress& progress) override {
    sink_ = &sink;
    if (summary_holds_)
      each_of_summary([&](unsigned opcode, ByteSpan content) {
        if (opcode == op_schema || opcode == op_channel) sink.known(opcode, content);
        return true;
      });
    try {
      walk({}, {}, progress, true);
    } catch (...) {
      sink_ = nullptr;
      throw;
    }
    sink_ = nullptr;
  }

  bool has_channel(std::uint16_t id) const override { return channels_.contains(id); }

  std::string losses() const override {
    std::string out;
    const auto add = [&](const std::string& what) { out += (out.empty() ? "" : "; ") + what; };
    const auto places = [](const Lost& lost, const char* what) {
      return lost.count == 1 ? fmt::format("1 {} at byte {}", what, lost.first)
                             : fmt::format("{} {}s, the first at byte {},", lost.count, what, lost.first);
    };
    const auto many = [](const Lost& lost, const char* one, const char* several) {
      return lost.count == 1 ? one : several;
    };
    if (lost_.crc.count > 0)
      add(fmt::format("{} {} and {} left out", places(lost_.crc, "chunk"),
                      many(lost_.crc, "fails its checksum", "fail their checksums"),
                      many(lost_.crc, "is", "are")));
    if (lost_.unreadable.count > 0)
      add(fmt::format("{} cannot be decoded and {} left out", places(lost_.unreadable, "chunk"),
                      many(lost_.unreadable, "is", "are")));
    if (lost_.broken.count > 0)
      add(fmt::format("{} {} damaged", places(lost_.broken, "record"), many(lost_.broken, "is", "are")));
    if (lost_.no_channel.count > 0)
      add(fmt::format("{} of no known topic {} left out", places(lost_.no_channel, "message"),
                      many(lost_.no_channel, "is", "are")));
    if (lost_.data_crc.count > 0)
      add(fmt::format("the checksum of the file's data fails, and {} that no other vouches for {} left out",
                      places(lost_.data_crc, "message"), many(lost_.data_crc, "is", "are")));
    if (stopped_at_) add(fmt::format("nothing is read from byte {} of {} on", *stopped_at_, file_.size()));
    if (!whole_ && !ended_) add("the end is missing, as where a recording was cut off");
    if (!whole_ && ended_) add("the summary at its end is cut off, all of its messages are read");
    if (summary_fails_) add("its summary fails its checksum and is not used");
    if (!out.empty() && unchecked_)
      out += "; it has no checksums of its messages, so that damage to values cannot be seen";
    return out;
  }

  std::string format() const override {
    return unchecked_ ? "MCAP without checksums of its messages: damage to values cannot be seen" : "MCAP";
  }

 private:
  struct Channel {
    std::uint16_t id = 0, schema = 0;
    BagTopic topic;
    bool wanted = false;
  };
  struct ChunkPlace {
    std::uint64_t offset = 0, length = 0;
    std::vector<std::uint16_t> channels;  ///< none: not said
  };
  struct Lost {
    std::uint64_t count = 0, first = 0;
    void add(std::uint64_t offset) {
      if (count++ == 0) first = offset;
    }
  };
  struct Losses {
    Lost crc, unreadable, broken, no_channel, data_crc;
  };
  using TakeOfChannel = std::function<void(Channel&, const BagMessage&)>;
  struct Head {
    unsigned opcode = 0;
    std::uint64_t length = 0;
  };

  bool is_magic(std::uint64_t offset) {
    return std::memcmp(file_.view(offset, kMagicSize).data(), kMagic, kMagicSize) == 0;
  }
  Head head_at(std::uint64_t offset) {
    RecordFields fields(file_.view(offset, kRecordHead));
    Head head;
    head.opcode = static_cast<unsigned>(fields.number(1)), head.length = fields.number(8);
    return head;
  }
  std::uint32_t crc_of(std::uint64_t from, std::uint64_t to, const Progress& progress = {}) {
    Crc32 crc;
    for (std::uint64_t at = from; at < to;) {
      const std::size_t part = std::min<std::uint64_t>(kWindow, to - at);
      crc.add(file_.view(at, part));
      at += part;
      if (progress) progress(static_cast<double>(at) / static_cast<double>(file_.size()));
    }
    return crc.value();
  }

  /// Where the summary and the data end, and their CRCs; whole_ is false where the file ends otherwise.
  void read_footer() {
    const std::uint64_t size = file_.size(), tail = kRecordHead + kFooterContent + kMagicSize;
    if (size < kMagicSize + tail || !is_magic(size - kMagicSize)) return;
    const std::uint64_t footer = size - tail;
    const Head head = head_at(footer);
    if (head.opcode != op_footer || head.length != kFooterContent) return;
    whole_ = true;
    RecordFields fields(file_.view(footer + kRecordHead, kFooterContent));
    summary_start_ = fields.number(8), fields.number(8), summary_crc_ = fields.crc();
    summary_end_ = footer;
    const std::uint64_t data_end =
        (summary_start_ > 0 ? summary_start_ : footer) - (kRecordHead + kDataEndContent);
    if (summary_start_ > footer || data_end < kMagicSize || data_end >= footer) return;
    const Head end = head_at(data_end);
    if (end.opcode != op_data_end || end.length != kDataEndContent) return;
    data_end_ = data_end, data_crc_ = RecordFields(file_.view(data_end + kRecordHead, kDataEndContent)).crc();
  }

  /// True if its CRC holds and it says everything that is asked of it.
  bool read_summary() {
    if (summary_start_ < kMagicSize || summary_start_ >= summary_end_ || summary_crc_ == 0) return false;
    summary_fails_ = crc_of(summary_start_, summary_end_ + kRecordHead + 16) != summary_crc_;
    if (summary_fails_) return false;
    std::uint64_t chunks_stated = 0, messages_stated = 0;
    bool counted = false;
    const bool read = each_of_summary([&](unsigned opcode, ByteSpan content) {
      RecordFields fields(content);
      if (opcode == op_schema || opcode == op_channel) {
        if (!declare(opcode, fields)) return false;
      } else if (opcode == op_chunk_index) {
        ChunkPlace place;
        fields.number(8), fields.number(8), place.offset = fields.number(8), place.length = fields.number(8);
        RecordFields channels(fields.take(fields.number(4)));
        while (!channels.rest().empty() && channels.sound())
          place.channels.push_back(channels.id()), channels.number(8);
        if (!fields.sound() || !channels.sound() || place.length < kRecordHead || place.offset < kMagicSize ||
            place.offset > summary_start_ || place.length > summary_start_ - place.offset)
          return false;
        place.channels.shrink_to_fit();
        chunks_.push_back(std::move(place));
      } else if (opcode == op_statistics) {
        messages_stated = fields.number(8), fields.take(2 + 4 + 4 + 4);
        chunks_stated = fields.number(4), fields.take(16);
        RecordFields counts(fields.take(fields.number(4)));
        while (!counts.rest().empty() && counts.sound()) {
          const std::uint16_t id = counts.id();
          counts_[id] = counts.number(8);
        }
        if (!fields.sound() || !counts.sound()) return false;
        counted = true;
      }
      return true;
    });
    if (!read) return false;
    for (const auto& [id, count] : counts_) {
      if (count > 0 && !channels_.contains(id)) return false;
      messages_stated -= count;
    }
    if (!counted || messages_stated != 0) counts_.clear();
    std::sort(chunks_.begin(), chunks_.end(),
              [](const ChunkPlace& a, const ChunkPlace& b) { return a.offset < b.offset; });
    for (std::size_t i = 1; i < chunks_.size(); ++i)
      if (chunks_[i].offset < chunks_[i - 1].offset + chunks_[i - 1].length) return false;
    indexed_ = counted && chunks_.size() == chunks_stated;
    if (!indexed_) chunks_.clear();
    return true;
  }

  /// Every record of the summary, until `take` is false. False then, and where its records make no sense.
  bool each_of_summary(const std::function<bool(unsigned opcode, ByteSpan content)>& take) {
    for (std::uint64_t at = summary_start_; at < summary_end_;) {
      if (summary_end_ - at < kRecordHead) return false;
      const Head head = head_at(at);
      at += kRecordHead;
      if (head.length > summary_end_ - at || head.length > kLargestMessage) return false;
      if (!take(head.opcode, file_.view(at, head.length))) return false;
      at += head.length;
    }
    return true;
  }

  /// A schema or a channel becomes known; what is known already stays. False for a record that is none.
  bool declare(unsigned opcode, RecordFields& fields) {
    const std::uint16_t id = fields.id();
    if (opcode == op_schema) {
      std::string name = fields.name();
      if (!fields.sound()) return false;
      schemas_.emplace(id, type_without_msg(std::move(name)));
      return true;
    }
    Channel channel;
    channel.id = id, channel.schema = fields.id();
    channel.topic.name = fields.name(), channel.topic.encoding = fields.name();
    if (!fields.sound()) return false;
    if (const auto schema = schemas_.find(channel.schema); schema != schemas_.end())
      channel.topic.type = schema->second;
    const auto [place, is_new] = channels_.emplace(id, std::move(channel));
    if (is_new) place->second.wanted = is_wanted(place->second.topic.name);
    return true;
  }
  bool is_wanted(const std::string& topic) const {
    return all_wanted_ || std::find(names_.begin(), names_.end(), topic) != names_.end();
  }

  /// From the first record to the last: every message of the topics of these names, or of all.
  void walk(const std::vector<std::string>& names, const TakeOfChannel& take, const Progress& progress,
            bool all) {
    names_ = names, all_wanted_ = all, lost_ = {}, stopped_at_.reset(), unchecked_ = false, ended_ = false;
    has_chunks_ = !chunks_.empty();
    progress_ = progress;
    for (auto& [id, channel] : channels_) channel.wanted = is_wanted(channel.topic.name);
    const std::uint64_t size = file_.size(), end = data_end_ > 0 ? data_end_ : size;
    std::size_t next = 0;  // chunk of the index
    for (std::uint64_t at = kMagicSize; at < end;) {
      if (progress_) progress_(static_cast<double>(at) / static_cast<double>(size));
      while (next < chunks_.size() && chunks_[next].offset < at) ++next;
      if (next < chunks_.size() && chunks_[next].offset == at) {
        const ChunkPlace& place = chunks_[next];
        if (holds_wanted(place)) take_chunk(at, place.length - kRecordHead, take);
        at += place.length;
        continue;
      }
      const std::uint64_t limit = next < chunks_.size() ? chunks_[next].offset : end;
      const std::uint64_t left = limit - at;
      const Head head = left < kRecordHead ? Head{} : head_at(at);
      if (left < kRecordHead || head.length > left - kRecordHead) {
        if (next == chunks_.size()) {
          if (whole_) lost_.broken.add(at);
          stopped_at_ = at;
          if (head.opcode == op_chunk && left > kRecordHead && !whole_)
            take_cut_chunk(at, left - kRecordHead, take);
          return;
        }
        lost_.broken.add(at), at = limit;  // the index says where it goes on
        continue;
      }
      const bool is_end = (head.opcode == op_data_end && head.length == kDataEndContent) ||
                          (head.opcode == op_footer && head.length == kFooterContent);
      if (is_end && next == chunks_.size()) {
        ended_ = true;
        return;
      }
      take_record(head, at, take);
      at += kRecordHead + head.length;
    }
    ended_ = data_end_ > 0;
  }

  bool holds_wanted(const ChunkPlace& place) const {
    if (place.channels.empty()) return true;
    return std::any_of(place.channels.begin(), place.channels.end(), [&](std::uint16_t id) {
      const auto channel = channels_.find(id);
      return channel == channels_.end() || channel->second.wanted;
    });
  }

  void take_record(const Head& head, std::uint64_t at, const TakeOfChannel& take) {
    if (head.opcode == op_chunk) {
      take_chunk(at, head.length, take);
    } else if (head.opcode == op_schema || head.opcode == op_channel) {
      if (head.length > kLargestMessage) return lost_.broken.add(at);
      const ByteSpan content = file_.view(at + kRecordHead, head.length);
      RecordFields fields(content);
      if (!declare(head.opcode, fields)) return lost_.broken.add(at);
      if (sink_) sink_->declared(head.opcode, content);
    } else if (head.opcode == op_message) {
      constexpr std::uint64_t fixed = 22;
      if (head.length < fixed) return lost_.broken.add(at);
      const auto channel = channels_.find(RecordFields(file_.view(at + kRecordHead, fixed)).id());
      if (channel == channels_.end()) return lost_.no_channel.add(at);
      if (!channel->second.wanted) return;
      if (head.length > kLargestMessage) return lost_.broken.add(at);
      if (!data_crc_holds()) return lost_.data_crc.add(at);
      // no writer mixes both: more likely the record of an index, which begins with a channel too, with a damaged opcode
      if (has_chunks_ && data_crc_ == 0) return lost_.broken.add(at);
      take_message(file_.view(at + kRecordHead, head.length), at, take);
    } else if (head.opcode ==
               op_message_index) {  // of another length: a chunk, perhaps, of which the opcode is damaged
      RecordFields fields(file_.view(at + kRecordHead, std::min<std::uint64_t>(head.length, 6)));
      fields.number(2);
      if (fields.number(4) != head.length - 6 || head.length < 6) lost_.broken.add(at);
    } else if (head.opcode == op_attachment || head.opcode == op_metadata ||
               head.opcode >= op_first_private || (head.opcode == op_header && at == kMagicSize)) {
      if (sink_)
        sink_->other(head.opcode, head.length, [&](std::uint64_t from, std::size_t size) {
          return file_.view(at + kRecordHead + from, size);
        });
    } else {
      lost_.broken.add(at);  // does not belong here
    }
  }

  void take_chunk(std::uint64_t at, std::uint64_t length, const TakeOfChannel& take) {
    has_chunks_ = true;
    if (length > kLargestChunk) return lost_.unreadable.add(at);
    RecordFields fields(file_.view(at + kRecordHead, length));
    fields.number(8), fields.number(8);
    const std::uint64_t size = fields.number(8);
    const std::uint32_t crc = fields.crc();
    const std::string compression = fields.name();
    const ByteSpan packed = fields.take(fields.number(8));
    if (!fields.sound()) return lost_.unreadable.add(at);
    if (crc == 0 && !packed.empty() && !data_crc_holds()) return lost_.data_crc.add(at);
    // data_crc_holds() moves the window where it reads the file for the first time
    const ByteSpan content = file_.view(at + kRecordHead, length);
    const std::size_t before = static_cast<std::size_t>(length) - fields.rest().size() - packed.size();
    const auto records = decompressor_.unpack(compression, content.subspan(before, packed.size()), size);
    if (!records) return lost_.unreadable.add(at);
    if (crc != 0) {
      Crc32 sum;
      sum.add(*records);
      if (sum.value() != crc) return lost_.crc.add(at);
    }
    if (sink_) sink_->chunk_begins(compression);
    if (take_records(*records, at, take) < records->size()) lost_.unreadable.add(at);
    if (sink_) sink_->chunk_ends(*records, content.subspan(before, packed.size()));
  }

  /// What is there of a chunk whose end is missing, as long as its bytes are the records themselves and nothing could be checked.
  void take_cut_chunk(std::uint64_t at, std::uint64_t length, const TakeOfChannel& take) {
    if (length > kLargestChunk) return;
    RecordFields fields(file_.view(at + kRecordHead, length));
    fields.take(8 + 8 + 8);
    const bool checked = fields.crc() != 0;
    const bool packed = !fields.name().empty();
    fields.number(8);
    if (!fields.sound() || checked || packed) return;
    unchecked_ = true;
    const std::uint64_t before = kRecordHead + length - fields.rest().size();
    if (sink_) sink_->chunk_begins("");
    stopped_at_ = at + before + take_records(fields.rest(), at, take);
    if (sink_) sink_->chunk_ends({}, {});
  }

  /// The records of a chunk. Returns how many of its bytes are whole records.
  std::size_t take_records(ByteSpan records, std::uint64_t at, const TakeOfChannel& take) {
    std::size_t whole = 0;
    for (RecordFields rest(records); !rest.rest().empty(); whole = records.size() - rest.rest().size()) {
      const auto opcode = static_cast<unsigned>(rest.number(1));
      const ByteSpan record = rest.take(rest.number(8));
      if (!rest.sound() || opcode == 0) return whole;
      if (opcode == op_message) {
        take_message(record, at, take);
      } else if (opcode == op_schema || opcode == op_channel) {
        RecordFields inner(record);
        if (!declare(opcode, inner))
          lost_.broken.add(at);
        else if (sink_)
          sink_->declared(opcode, record);
      }
    }
    return whole;
  }

  void take_message(ByteSpan record, std::uint64_t at, const TakeOfChannel& take) {
    RecordFields fields(record);
    const std::uint16_t id = fields.id();
    fields.number(4);
    const auto time = static_cast<std::int64_t>(fields.number(8));
    fields.number(8);
    if (!fields.sound()) return lost_.broken.add(at);
    const auto channel = channels_.find(id);
    if (channel == channels_.end()) return lost_.no_channel.add(at);
    if (sink_) return sink_->message(channel->second.topic, record);
    if (channel->second.wanted) take(channel->second, {channel->second.topic, time, fields.rest()});
  }

  /// False if the data section has a CRC that fails; read once, for what has no CRC of its own. Notes where there is none at all.
  bool data_crc_holds() {
    if (data_crc_ == 0) {
      unchecked_ = true;
      return true;
    }
    if (!data_holds_) data_holds_ = crc_of(0, data_end_, progress_) == data_crc_;
    return *data_holds_;
  }

  std::string path_;
  FileWindow file_;
  Decompressor decompressor_;
  bool whole_ = false, indexed_ = false, all_wanted_ = false, unchecked_ = false, ended_ = true,
       has_chunks_ = false, summary_fails_ = false, summary_holds_ = false;
  McapSink* sink_ = nullptr;  ///< while the file is copied
  std::uint64_t summary_start_ = 0, summary_end_ = 0, data_end_ = 0;
  std::uint32_t summary_crc_ = 0, data_crc_ = 0;
  std::optional<bool> data_holds_;
  std::map<std::uint16_t, std::string> schemas_;
  std::map<std::uint16_t, Channel> channels_;
  std::map<std::uint16_t, std::uint64_t> counts_;
  std::vector<ChunkPlace>
      chunks_;  ///< by the index, in the order of their offsets; none where it is not trusted
  std::vector<std::string> names_;
  Progress progress_;
  Losses lost_;
  std::optional<std::uint64_t> stopped_at_;
};

}  // namespace

std::unique_ptr<McapFile> open_mcap(const std::string& path) { return std::make_unique<McapSource>(path); }

}  // namespace rangecal::ingest
