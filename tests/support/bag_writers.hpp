// SPDX-License-Identifier: BSD-3-Clause
// Writers of small bags, from the same specifications as the readers and without their code: messages, MCAP, SQLite of rosbag2.
#pragma once

#include <lz4frame.h>
#include <sqlite3.h>
#include <zstd.h>

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <map>
#include <set>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

namespace rangecal::test {

/// A number in the given byte order.
template <typename Number>
std::string raw_number(Number value, bool big_endian = false) {
  std::string out(sizeof value, '\0');
  std::memcpy(out.data(), &value, sizeof value);
  if (big_endian != (std::endian::native == std::endian::big)) std::reverse(out.begin(), out.end());
  return out;
}

enum class Form { little, big, ros1 };

/// The bytes of a ROS message.
class MessageWriter {
 public:
  explicit MessageWriter(Form form = Form::little) : form_(form) {
    if (form == Form::little) bytes_ = std::string("\0\1\0\0", 4);
    if (form == Form::big) bytes_ = std::string("\0\0\0\0", 4);
  }
  template <typename Number>
  MessageWriter& put(Number value) {
    if (form_ != Form::ros1)
      while ((bytes_.size() - 4) % sizeof value != 0) bytes_ += '\0';
    bytes_ += raw_number(value, form_ == Form::big);
    return *this;
  }
  MessageWriter& text(const std::string& words) {
    const bool ended = form_ != Form::ros1;
    put(static_cast<std::uint32_t>(words.size() + (ended ? 1 : 0)));
    bytes_ += words;
    if (ended) bytes_ += '\0';
    return *this;
  }
  MessageWriter& floats(const std::vector<float>& values) {
    put(static_cast<std::uint32_t>(values.size()));
    for (const float value : values) put(value);
    return *this;
  }
  MessageWriter& header(double stamp_s, const std::string& frame) {
    if (form_ == Form::ros1) put(std::uint32_t{7});
    const double whole = std::floor(stamp_s);
    put(static_cast<std::int32_t>(whole))
        .put(static_cast<std::uint32_t>(std::lround(1e9 * (stamp_s - whole))));
    return text(frame);
  }
  /// Position and orientation: a turn about z.
  MessageWriter& pose(double x, double y, double heading_rad) {
    for (const double value : {x, y, 0.0, 0.0, 0.0, std::sin(heading_rad / 2), std::cos(heading_rad / 2)})
      put(value);
    return *this;
  }
  MessageWriter& doubles(int count) {
    for (int i = 0; i < count; ++i) put(0.01 * i);
    return *this;
  }
  const std::string& bytes() const { return bytes_; }

 private:
  Form form_;
  std::string bytes_;
};

inline std::string laser_scan(double stamp_s, float angle_min, float increment,
                              const std::vector<float>& ranges, Form form = Form::little) {
  MessageWriter out(form);
  out.header(stamp_s, "laser")
      .put(angle_min)
      .put(angle_min + increment * static_cast<float>(ranges.size() - 1));
  out.put(increment).put(0.0f).put(0.1f).put(0.05f).put(20.0f);
  return out.floats(ranges).floats(std::vector<float>(ranges.size(), 47.0f)).bytes();
}
inline std::string odometry(double stamp_s, double x, double y, double heading_rad,
                            Form form = Form::little) {
  MessageWriter out(form);
  return out.header(stamp_s, "odom").text("base_link").pose(x, y, heading_rad).doubles(36 + 6 + 36).bytes();
}
inline std::string pose_stamped(double stamp_s, double x, double y, double heading_rad,
                                Form form = Form::little) {
  return MessageWriter(form).header(stamp_s, "map").pose(x, y, heading_rad).bytes();
}

struct WrittenTopic {
  std::string name, type, encoding = "cdr";
};
struct WrittenMessage {
  std::size_t topic = 0;
  std::int64_t time_ns = 0;
  std::string bytes;
};

struct McapForm {
  std::size_t per_chunk = 0;  ///< messages of a chunk; 0: no chunks
  std::string compression = {};
  bool chunk_crc = true, data_crc = false, summary = true, summary_crc = true;
};

/// CRC-32 of IEEE 802.3, bit by bit.
inline std::uint32_t crc32_of(const std::string& bytes) {
  std::uint32_t crc = 0xffffffffu;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1) != 0 ? (crc >> 1) ^ 0xedb88320u : crc >> 1;
  }
  return ~crc;
}

inline std::string compressed(const std::string& bytes, const std::string& how) {
  std::string out;
  if (how == "lz4") {
    out.resize(LZ4F_compressFrameBound(bytes.size(), nullptr));
    out.resize(LZ4F_compressFrame(out.data(), out.size(), bytes.data(), bytes.size(), nullptr));
  } else if (how == "zstd") {
    out.resize(ZSTD_compressBound(bytes.size()));
    out.resize(ZSTD_compress(out.data(), out.size(), bytes.data(), bytes.size(), 1));
  } else {
    out = bytes;
  }
  return out;
}

/// An MCAP file piece by piece: what is not yet taken stands in `bytes`.
class McapWriter {
 public:
  std::string bytes;

  McapWriter(const std::vector<WrittenTopic>& topics, const McapForm& form) : topics_(topics), form_(form) {
    add(kMagic + record(0x01, text("ros2") + text("rangecal tests")));
    if (form.per_chunk == 0) add(declarations());
  }
  void write(const WrittenMessage& message) {
    const std::string one =
        record(0x05, raw_number(static_cast<std::uint16_t>(message.topic + 1)) + raw_number(++count_) +
                         raw_number(message.time_ns) + raw_number(message.time_ns) + message.bytes);
    ++counts_[message.topic];
    if (form_.per_chunk == 0) return add(one);
    if (chunk_.empty()) chunk_ = declarations(), first_ = message.time_ns;
    index_[message.topic].emplace_back(message.time_ns, chunk_.size());
    chunk_ += one, last_ = message.time_ns;
    if (++in_chunk_ == form_.per_chunk) close_chunk();
  }
  void finish() {
    if (!chunk_.empty()) close_chunk();
    add(record(0x0f, raw_number(form_.data_crc ? crc32_of(data_) : 0u)));
    const std::uint64_t start = offset_;
    std::string summary;
    if (form_.summary) {
      std::string counts;
      for (const auto& [topic, count] : counts_)
        counts += raw_number(static_cast<std::uint16_t>(topic + 1)) + raw_number(count);
      summary = declarations() +
                record(0x0b, raw_number(std::uint64_t{count_}) +
                                 raw_number(static_cast<std::uint16_t>(topics_.size())) +
                                 raw_number(static_cast<std::uint32_t>(topics_.size())) + raw_number(0u) +
                                 raw_number(0u) + raw_number(chunks_) + raw_number(std::uint64_t{0}) +
                                 raw_number(std::uint64_t{0}) + text(counts)) +
                chunk_index_;
    }
    const std::string footer =
        raw_number(summary.empty() ? std::uint64_t{0} : start) + raw_number(std::uint64_t{0});
    const std::string head = std::string(1, '\x02') + raw_number(std::uint64_t{20});
    const std::uint32_t crc = form_.summary && form_.summary_crc ? crc32_of(summary + head + footer) : 0u;
    add(summary + head + footer + raw_number(crc) + kMagic);
  }

 private:
  static inline const std::string kMagic = std::string("\x89MCAP0\r\n");
  static std::string text(const std::string& words) {
    return raw_number(static_cast<std::uint32_t>(words.size())) + words;
  }
  static std::string record(int opcode, const std::string& content) {
    return static_cast<char>(opcode) + raw_number(std::uint64_t{content.size()}) + content;
  }
  std::string declarations() const {
    std::string out;
    for (std::size_t i = 0; i < topics_.size(); ++i) {
      const auto id = raw_number(static_cast<std::uint16_t>(i + 1));
      out += record(0x03, id + text(topics_[i].type) + text("ros2msg") + text("# not read"));
      out += record(0x04, id + id + text(topics_[i].name) + text(topics_[i].encoding) + text(""));
    }
    return out;
  }
  void close_chunk() {
    const std::string packed = compressed(chunk_, form_.compression),
                      times = raw_number(first_) + raw_number(last_);
    const std::string size = raw_number(std::uint64_t{chunk_.size()}),
                      packed_size = raw_number(std::uint64_t{packed.size()});
    const std::string one = record(0x06, times + size + raw_number(form_.chunk_crc ? crc32_of(chunk_) : 0u) +
                                             text(form_.compression) + packed_size + packed);
    std::string places, indexes;
    for (const auto& [topic, entries] : index_) {
      const auto id = raw_number(static_cast<std::uint16_t>(topic + 1));
      places += id + raw_number(offset_ + one.size() + indexes.size());
      std::string list;
      for (const auto& [time, at] : entries) list += raw_number(time) + raw_number(std::uint64_t{at});
      indexes += record(0x07, id + text(list));
    }
    chunk_index_ += record(0x08, times + raw_number(offset_) + raw_number(std::uint64_t{one.size()}) +
                                     text(places) + raw_number(std::uint64_t{indexes.size()}) +
                                     text(form_.compression) + packed_size + size);
    add(one + indexes);
    ++chunks_, chunk_.clear(), index_.clear(), in_chunk_ = 0;
  }
  void add(const std::string& more) {
    bytes += more, offset_ += more.size();
    if (form_.data_crc) data_ += more;
  }

  std::vector<WrittenTopic> topics_;
  McapForm form_;
  std::string chunk_, chunk_index_, data_;
  std::map<std::size_t, std::vector<std::pair<std::int64_t, std::size_t>>> index_;
  std::map<std::size_t, std::uint64_t> counts_;
  std::uint64_t offset_ = 0;
  std::uint32_t count_ = 0, chunks_ = 0;
  std::size_t in_chunk_ = 0;
  std::int64_t first_ = 0, last_ = 0;
};

inline std::string mcap_file(const std::vector<WrittenTopic>& topics,
                             const std::vector<WrittenMessage>& messages, const McapForm& form) {
  McapWriter writer(topics, form);
  for (const WrittenMessage& message : messages) writer.write(message);
  writer.finish();
  return writer.bytes;
}

/// An SQLite file as rosbag2 lays it out.
inline void write_db3(const std::string& path, const std::vector<WrittenTopic>& topics,
                      const std::vector<WrittenMessage>& messages) {
  sqlite3* database = nullptr;
  const auto sound = [&](int code) {
    if (code != SQLITE_OK && code != SQLITE_DONE) throw std::runtime_error(sqlite3_errmsg(database));
  };
  sound(sqlite3_open(path.c_str(), &database));
  sound(sqlite3_exec(
      database,
      "CREATE TABLE topics(id INTEGER PRIMARY KEY, name TEXT NOT NULL, type TEXT NOT NULL, "
      "serialization_format TEXT NOT NULL, offered_qos_profiles TEXT NOT NULL);"
      "CREATE TABLE messages(id INTEGER PRIMARY KEY, topic_id INTEGER NOT NULL, timestamp INTEGER NOT NULL, "
      "data BLOB NOT NULL); CREATE INDEX timestamp_idx ON messages(timestamp ASC); BEGIN",
      nullptr, nullptr, nullptr));
  sqlite3_stmt* row = nullptr;
  sound(sqlite3_prepare_v2(database, "INSERT INTO topics VALUES(?, ?, ?, ?, '')", -1, &row, nullptr));
  for (std::size_t i = 0; i < topics.size(); ++i) {
    sqlite3_bind_int64(row, 1, static_cast<sqlite3_int64>(i + 1));
    int column = 2;
    for (const std::string& words : {topics[i].name, topics[i].type, topics[i].encoding})
      sqlite3_bind_text(row, column++, words.c_str(), -1, SQLITE_TRANSIENT);
    sound(sqlite3_step(row)), sound(sqlite3_reset(row));
  }
  sqlite3_finalize(row);
  sound(sqlite3_prepare_v2(database, "INSERT INTO messages(topic_id, timestamp, data) VALUES(?, ?, ?)", -1,
                           &row, nullptr));
  for (const WrittenMessage& message : messages) {
    sqlite3_bind_int64(row, 1, static_cast<sqlite3_int64>(message.topic + 1));
    sqlite3_bind_int64(row, 2, message.time_ns);
    sqlite3_bind_blob(row, 3, message.bytes.data(), static_cast<int>(message.bytes.size()), SQLITE_TRANSIENT);
    sound(sqlite3_step(row)), sound(sqlite3_reset(row));
  }
  sqlite3_finalize(row);
  sound(sqlite3_exec(database, "COMMIT", nullptr, nullptr, nullptr));
  sqlite3_close(database);
}

}  // namespace rangecal::test
