// SPDX-License-Identifier: BSD-3-Clause
#include "bags/sqlite_source.hpp"

#include <fmt/core.h>
#include <sqlite3.h>

#include <algorithm>
#include <filesystem>
#include <map>
#include <mutex>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

constexpr int kLargestValue = 512 << 20;
constexpr std::size_t kMostTopics = 100000;

/// A path as a URI of SQLite.
std::string uri_of(const std::string& path, const char* query) {
  std::string uri = "file:";
  for (const char c : std::filesystem::absolute(path).string())
    if (c == '%' || c == '?' || c == '#' || static_cast<unsigned char>(c) < 0x20)
      uri += fmt::format("%{:02x}", static_cast<unsigned char>(c));
    else
      uri += c;
  return uri + query;
}

/// A file that was cut off may end within a page, of which SQLite takes the missing bytes as zeros: wrong values that nothing
/// shows. The system's file functions therefore serve here with one difference, a file's size in whole pages; what lies beyond is
/// damage that SQLite sees.
class WholePages {
 public:
  /// The name to open a file with.
  static const char* name() {
    static const bool known = [] {
      original() = sqlite3_vfs_find(nullptr);
      if (!original()) return false;
      static sqlite3_vfs own = *original();
      own.zName = "rangecal-whole-pages", own.pNext = nullptr, own.xOpen = &open;
      return sqlite3_vfs_register(&own, 0) == SQLITE_OK;
    }();
    return known ? "rangecal-whole-pages" : nullptr;
  }

 private:
  static sqlite3_vfs*& original() {
    static sqlite3_vfs* found = nullptr;
    return found;
  }
  /// Each set of functions that the system's files have, by the copy with the other size.
  static std::map<const sqlite3_io_methods*, const sqlite3_io_methods*>& originals() {
    static std::map<const sqlite3_io_methods*, const sqlite3_io_methods*> all;
    return all;
  }
  static std::mutex& lock() {
    static std::mutex one;
    return one;
  }
  static int open(sqlite3_vfs*, sqlite3_filename path, sqlite3_file* file, int flags, int* given) {
    const int code = original()->xOpen(original(), path, file, flags, given);
    if (code != SQLITE_OK || !file->pMethods || (flags & SQLITE_OPEN_MAIN_DB) == 0) return code;
    static std::map<const sqlite3_io_methods*, sqlite3_io_methods> copies;
    const std::lock_guard guard(lock());
    const auto [copy, is_new] = copies.emplace(file->pMethods, *file->pMethods);
    copy->second.xFileSize = &size;
    originals()[&copy->second] = file->pMethods;
    file->pMethods = &copy->second;
    return code;
  }
  static int size(sqlite3_file* file, sqlite3_int64* bytes) {
    const sqlite3_io_methods* functions = nullptr;
    {
      const std::lock_guard guard(lock());
      functions = originals().at(file->pMethods);
    }
    const int code = functions->xFileSize(file, bytes);
    unsigned char stated[2];  // the size of a page stands at byte 16, 1 for 65536
    if (code != SQLITE_OK || *bytes < 100 || functions->xRead(file, stated, 2, 16) != SQLITE_OK) return code;
    const sqlite3_int64 page = stated[0] == 0 && stated[1] == 1 ? 65536 : stated[0] << 8 | stated[1];
    if (page >= 512) *bytes -= *bytes % page;
    return code;
  }
};

bool has_bytes(const std::string& path) {
  std::error_code error;
  const auto size = std::filesystem::file_size(path, error);
  return !error && size > 0;
}

[[noreturn]] void no_bag(const std::string& path, const std::string& why) {
  throw InputError(path, 0, "", "cannot be read as an SQLite file of rosbag2: " + why);
}

class SqliteSource : public MessageSource {
 public:
  explicit SqliteSource(const std::string& path) : path_(path), database_(open_sqlite_to_read(path)) {
    read_topics();
  }

  std::vector<BagTopic> topics() override {
    std::map<std::int64_t, BagTopic> counted = topics_;
    step_through("SELECT topic_id FROM messages ORDER BY rowid", [&](sqlite3_stmt* row) {
      if (const auto topic = counted.find(sqlite3_column_int64(row, 0)); topic != counted.end())
        ++topic->second.messages;
    });
    std::vector<BagTopic> topics;
    for (auto& [id, topic] : counted) topics.push_back(std::move(topic));
    return merged(std::move(topics));
  }

  void read(const std::vector<std::string>& names, const Take& take, const Progress& progress) override {
    std::string ids;
    for (const auto& [id, topic] : topics_)
      if (std::find(names.begin(), names.end(), topic.name) != names.end())
        ids += fmt::format("{}{}", ids.empty() ? "" : ",", id);
    double last = 1.0;
    if (progress) {
      step_through("SELECT max(rowid) FROM messages",
                   [&](sqlite3_stmt* row) { last = std::max(1.0, sqlite3_column_double(row, 0)); });
    }
    const std::string query = "SELECT topic_id, timestamp, data, rowid FROM messages WHERE topic_id IN (" +
                              ids + ") ORDER BY rowid";
    step_through(query, [&](sqlite3_stmt* row) {
      const auto topic = topics_.find(sqlite3_column_int64(row, 0));
      if (topic == topics_.end()) return;
      const void* data = sqlite3_column_blob(row, 2);
      const int size = data ? sqlite3_column_bytes(row, 2) : 0;
      if (progress) progress(std::min(1.0, sqlite3_column_double(row, 3) / last));
      take({topic->second,
            sqlite3_column_int64(row, 1),
            {static_cast<const std::byte*>(data), static_cast<std::size_t>(size)}});
    });
  }

  std::string losses() const override {
    if (stopped_.empty()) return "";
    return fmt::format(
        "its messages are read up to the {}th, then SQLite says: {}; it has no checksums, so that damage to "
        "values cannot be seen",
        rows_, stopped_);
  }
  std::string format() const override {
    return "SQLite of rosbag2, without checksums: damage to values cannot be seen";
  }

 private:
  [[noreturn]] void refuse(const std::string& why) const { no_bag(path_, why); }

  void read_topics() {
    step_through("SELECT id, name, type, serialization_format FROM topics", [&](sqlite3_stmt* row) {
      if (topics_.size() >= kMostTopics) refuse(fmt::format("it has more than {} topics", kMostTopics));
      const auto text = [&](int column) {
        const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(row, column));
        return std::string(bytes ? bytes : "").substr(0, 4096);
      };
      topics_[sqlite3_column_int64(row, 0)] = {text(1), type_without_msg(text(2)), text(3)};
    });
    if (topics_.empty() && !stopped_.empty()) refuse(stopped_);
  }

  /// Every row of a query, as far as the file can be read. Throws InputError where it is no query of this file.
  template <typename TakeRow>
  void step_through(const std::string& query, const TakeRow& take) {
    rows_ = 0, stopped_.clear();
    sqlite3_stmt* prepared = nullptr;
    const int code = sqlite3_prepare_v2(database_.get(), query.c_str(), -1, &prepared, nullptr);
    const std::unique_ptr<sqlite3_stmt, decltype(&sqlite3_finalize)> statement(prepared, &sqlite3_finalize);
    if (code != SQLITE_OK) refuse(sqlite3_errmsg(database_.get()));
    for (;; ++rows_) {
      const int step = sqlite3_step(prepared);
      if (step == SQLITE_DONE) return;
      if (step != SQLITE_ROW) {
        stopped_ = sqlite3_errmsg(database_.get());
        return;
      }
      take(prepared);
    }
  }

  std::string path_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> database_;
  std::map<std::int64_t, BagTopic> topics_;
  std::uint64_t rows_ = 0;
  std::string stopped_;  ///< why the last query ended before its last row
};

}  // namespace

std::unique_ptr<sqlite3, int (*)(sqlite3*)> open_sqlite_to_read(const std::string& path) {
  if (has_bytes(path + "-journal"))
    throw InputError(path, 0, "",
                     "was not closed by its recorder: let `sqlite3` open it once, or take its -journal away");
  // unless a log of writes stands beside it, nothing may be locked or created in its folder
  const char* query = has_bytes(path + "-wal") ? "?mode=ro" : "?mode=ro&immutable=1";
  sqlite3* database = nullptr;
  const int code =
      sqlite3_open_v2(uri_of(path, query).c_str(), &database,
                      SQLITE_OPEN_READONLY | SQLITE_OPEN_URI | SQLITE_OPEN_NOMUTEX, WholePages::name());
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> opened(database, &sqlite3_close_v2);
  if (code != SQLITE_OK) no_bag(path, database ? sqlite3_errmsg(database) : "no memory");
  sqlite3_limit(database, SQLITE_LIMIT_LENGTH, kLargestValue);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_VIEW, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_ENABLE_TRIGGER, 0, nullptr);
  sqlite3_db_config(database, SQLITE_DBCONFIG_TRUSTED_SCHEMA, 0, nullptr);
  // with writable_schema SQLite opens a file that is shorter than its first page says; nothing is written
  sqlite3_exec(database, "PRAGMA cell_size_check = ON; PRAGMA writable_schema = ON", nullptr, nullptr,
               nullptr);
  return opened;
}

std::unique_ptr<MessageSource> open_sqlite_bag(const std::string& path) {
  return std::make_unique<SqliteSource>(path);
}

}  // namespace rangecal::ingest
