// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>
#include <sqlite3.h>

#include <algorithm>
#include <cctype>
#include <map>
#include <memory>
#include <string>
#include <vector>

#include "bags/bag_copy.hpp"
#include "bags/sqlite_source.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::ingest {
namespace {

using Statement = std::unique_ptr<sqlite3_stmt, int (*)(sqlite3_stmt*)>;

std::string quoted(const std::string& name) {
  std::string out = "\"";
  for (const char c : name) out += c == '"' ? "\"\"" : std::string(1, c);
  return out + "\"";
}
bool starts_with_words(const std::string& sql, const std::string& words) {
  return sql.size() > words.size() && std::equal(words.begin(), words.end(), sql.begin(), [](char a, char b) {
           return a == std::toupper(static_cast<unsigned char>(b));
         });
}

class SqliteCopy {
 public:
  SqliteCopy(const std::string& from, const std::string& to, const BagChange& change,
             const MessageSource::Progress& progress)
      : from_path_(from),
        change_(change),
        progress_(progress),
        from_(open_sqlite_to_read(from)),
        file_(to),
        to_(nullptr, &sqlite3_close_v2) {
    sqlite3* database = nullptr;
    const int code =
        sqlite3_open_v2(file_.partial_path().c_str(), &database,
                        SQLITE_OPEN_READWRITE | SQLITE_OPEN_CREATE | SQLITE_OPEN_NOMUTEX, nullptr);
    to_.reset(database);
    if (code != SQLITE_OK) cannot_write();
    execute("PRAGMA journal_mode = OFF");  // the file has no name yet that anybody knows
    execute("PRAGMA synchronous = OFF");
    execute("BEGIN");
  }

  std::string copy() {
    read_topics();
    std::vector<std::string> tables, indexes;
    each_row(
        "SELECT type, name, sql FROM sqlite_master WHERE sql IS NOT NULL AND name NOT LIKE 'sqlite\\_%' ESCAPE '\\'",
        "list of tables", [&](sqlite3_stmt* row) {
          const std::string type = text(row, 0), name = text(row, 1), sql = text(row, 2);
          if (type == "table" && starts_with_words(sql, "CREATE TABLE")) {
            execute(sql);
            tables.push_back(name);
          } else if (type == "index") {
            indexes.push_back(sql);
          }
        });
    for (const std::string& name : tables)
      if (name == "messages")
        copy_messages();
      else
        copy_table(name);
    if (!change_.keep_raw.empty()) keep_raw();
    for (const std::string& sql : indexes)
      if (starts_with_words(sql, "CREATE INDEX") || starts_with_words(sql, "CREATE UNIQUE INDEX"))
        execute(sql);
    write_note();
    execute("COMMIT");
    if (sqlite3_close_v2(to_.release()) != SQLITE_OK)
      throw InputError(file_.path(), 0, "", "cannot be written");
    file_.put_in_place();
    return losses_;
  }

 private:
  static std::string text(sqlite3_stmt* row, int column) {
    const auto* bytes = reinterpret_cast<const char*>(sqlite3_column_text(row, column));
    return bytes ? bytes : "";
  }
  [[noreturn]] void cannot_write() const {
    throw InputError(file_.path(), 0, "", fmt::format("cannot be written: {}", sqlite3_errmsg(to_.get())));
  }
  Statement prepared(sqlite3* database, const std::string& sql) const {
    sqlite3_stmt* statement = nullptr;
    const int code = sqlite3_prepare_v2(database, sql.c_str(), -1, &statement, nullptr);
    Statement out(statement, &sqlite3_finalize);
    if (code == SQLITE_OK && statement) return out;
    if (database == to_.get()) cannot_write();
    throw InputError(
        from_path_, 0, "",
        fmt::format("cannot be read as an SQLite file of rosbag2: {}", sqlite3_errmsg(database)));
  }
  /// One statement, whatever stands behind it.
  void execute(const std::string& sql) const { run(prepared(to_.get(), sql).get()); }
  void run(sqlite3_stmt* statement) const {
    int code = SQLITE_ROW;
    while (code == SQLITE_ROW) code = sqlite3_step(statement);
    if (code != SQLITE_DONE) cannot_write();
    sqlite3_reset(statement);
  }

  template <typename TakeRow>
  void each_row(const std::string& sql, const std::string& what, const TakeRow& take) {
    const Statement statement = prepared(from_.get(), sql);
    std::uint64_t rows = 0;
    int code = sqlite3_step(statement.get());
    for (; code == SQLITE_ROW; code = sqlite3_step(statement.get()), ++rows) take(statement.get());
    if (code != SQLITE_DONE && losses_.empty())
      losses_ = fmt::format(
          "its {} {} read up to the {}th, then SQLite says: {}; it has no checksums, so that damage to values "
          "cannot be seen",
          what, what == "messages" ? "are" : "is", rows, sqlite3_errmsg(from_.get()));
  }

  void read_topics() {
    each_row("SELECT id, name, type, serialization_format FROM topics", "topics", [&](sqlite3_stmt* row) {
      topics_[sqlite3_column_int64(row, 0)] = {text(row, 1), type_without_msg(text(row, 2)), text(row, 3)};
    });
  }

  Statement insertion(const std::string& table, int columns) const {
    std::string marks;
    for (int i = 0; i < columns; ++i) marks += i == 0 ? "?" : ", ?";
    return prepared(to_.get(), fmt::format("INSERT INTO {} VALUES({})", quoted(table), marks));
  }
  int columns_of(const std::string& table) const {
    return sqlite3_column_count(prepared(from_.get(), "SELECT * FROM " + quoted(table)).get());
  }
  static void bind_row(sqlite3_stmt* to, sqlite3_stmt* row, int columns) {
    for (int i = 0; i < columns; ++i) sqlite3_bind_value(to, i + 1, sqlite3_column_value(row, i));
  }

  void copy_table(const std::string& name) {
    if (name == kNoteTable)
      each_row(fmt::format("SELECT key, value FROM {}", kNoteTable), "note", [&](sqlite3_stmt* row) {
        if (text(row, 0) == "topic" && text(row, 1) == change_.topic)
          throw InputError(
              from_path_, 0, "",
              fmt::format("its {} is corrected already, as its table {} says", change_.topic, kNoteTable));
      });
    const int columns = columns_of(name);
    const Statement insert = insertion(name, columns);
    each_row("SELECT * FROM " + quoted(name), "table " + name, [&](sqlite3_stmt* row) {
      bind_row(insert.get(), row, columns);
      run(insert.get());
    });
  }

  struct MessageColumns {
    int topic = -1, time = -1, data = -1, id = -1, count = 0;
  };
  MessageColumns message_columns() const {
    const Statement all = prepared(from_.get(), "SELECT * FROM messages");
    MessageColumns at;
    at.count = sqlite3_column_count(all.get());
    for (int i = 0; i < at.count; ++i) {
      const std::string name = sqlite3_column_name(all.get(), i);
      if (name == "topic_id") at.topic = i;
      if (name == "timestamp") at.time = i;
      if (name == "data") at.data = i;
      if (name == "id") at.id = i;
    }
    if (at.topic < 0 || at.time < 0 || at.data < 0 || at.id < 0)
      throw InputError(from_path_, 0, "", "its table of messages lacks id, topic_id, timestamp or data");
    return at;
  }

  void copy_messages() {
    const MessageColumns at = message_columns();
    const Statement insert = insertion("messages", at.count);
    double last = 1.0;
    if (progress_)
      each_row("SELECT max(rowid) FROM messages", "messages",
               [&](sqlite3_stmt* row) { last = std::max(1.0, sqlite3_column_double(row, 0)); });
    each_row("SELECT * FROM messages ORDER BY rowid", "messages", [&](sqlite3_stmt* row) {
      if (progress_) progress_(std::min(1.0, sqlite3_column_double(row, at.id) / last));
      bind_row(insert.get(), row, at.count);
      const auto topic = topics_.find(sqlite3_column_int64(row, at.topic));
      if (topic != topics_.end() && topic->second.name == change_.topic) {
        const void* data = sqlite3_column_blob(row, at.data);
        const int size = data ? sqlite3_column_bytes(row, at.data) : 0;
        const auto changed =
            change_.change({topic->second,
                            sqlite3_column_int64(row, at.time),
                            {static_cast<const std::byte*>(data), static_cast<std::size_t>(size)}});
        if (!changed) return;
        sqlite3_bind_blob(insert.get(), at.data + 1, changed->data(), static_cast<int>(changed->size()),
                          SQLITE_STATIC);
      }
      run(insert.get());
    });
  }

  void keep_raw() {
    const int columns = columns_of("topics");
    const Statement insert = insertion("topics", columns);
    sqlite3_int64 free = topics_.empty() ? 1 : topics_.rbegin()->first + 1;
    std::map<sqlite3_int64, sqlite3_int64> raw;
    each_row("SELECT * FROM topics", "topics", [&](sqlite3_stmt* row) {
      sqlite3_int64 id = 0;
      bool ours = false;
      for (int i = 0; i < columns; ++i) {
        const std::string name = sqlite3_column_name(row, i);
        if (name == "id") id = sqlite3_column_int64(row, i);
        if (name == "name") ours = text(row, i) == change_.topic;
      }
      if (!ours) return;
      bind_row(insert.get(), row, columns);
      for (int i = 0; i < columns; ++i) {
        const std::string name = sqlite3_column_name(row, i);
        if (name == "id") sqlite3_bind_int64(insert.get(), i + 1, free);
        if (name == "name")
          sqlite3_bind_text(insert.get(), i + 1, change_.keep_raw.c_str(), -1, SQLITE_STATIC);
      }
      run(insert.get());
      raw[id] = free++;
    });
    const MessageColumns at = message_columns();
    const Statement message = insertion("messages", at.count);
    for (const auto& [from, to] : raw)
      each_row(fmt::format("SELECT * FROM messages WHERE topic_id = {} ORDER BY rowid", from), "messages",
               [&, to = to](sqlite3_stmt* row) {
                 bind_row(message.get(), row, at.count);
                 sqlite3_bind_null(message.get(), at.id + 1);  // the next
                 sqlite3_bind_int64(message.get(), at.topic + 1, to);
                 run(message.get());
               });
  }

  void write_note() const {
    execute(fmt::format("CREATE TABLE IF NOT EXISTS {}(key TEXT NOT NULL, value TEXT NOT NULL)", kNoteTable));
    const Statement insert = insertion(kNoteTable, 2);
    for (const auto& [key, value] : change_.note()) {
      sqlite3_bind_text(insert.get(), 1, key.c_str(), -1, SQLITE_TRANSIENT);
      sqlite3_bind_text(insert.get(), 2, value.c_str(), -1, SQLITE_TRANSIENT);
      run(insert.get());
    }
  }

  std::string from_path_;
  const BagChange& change_;
  const MessageSource::Progress& progress_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> from_;
  PartialFile file_;
  std::unique_ptr<sqlite3, int (*)(sqlite3*)> to_;
  std::map<std::int64_t, BagTopic> topics_;
  std::string losses_;
};

}  // namespace

BagCopied copy_sqlite_bag(const std::string& from, const std::string& to, const BagChange& change,
                          const MessageSource::Progress& progress) {
  return {SqliteCopy(from, to, change, progress).copy(),
          "SQLite of rosbag2, without checksums: damage to values cannot be seen"};
}

}  // namespace rangecal::ingest
