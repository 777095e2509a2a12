// SPDX-License-Identifier: BSD-3-Clause
#include "bags/sqlite_source.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/bag_writers.hpp"
#include "support/recordings.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::ingest {
namespace {

using test::TemporaryFolder;
using ::testing::HasSubstr;
using ::testing::Not;

const std::vector<test::WrittenTopic> kTwoTopics = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                                    {"/odom", "nav_msgs/msg/Odometry"}};

/// Messages of which every third fills more than a page.
std::vector<test::WrittenMessage> messages_of_sizes() {
  std::vector<test::WrittenMessage> out;
  for (int i = 0; i < 30; ++i) {
    const std::size_t size = i % 3 == 0 ? 9000 : 200;
    out.push_back({static_cast<std::size_t>(i % 2), 1000 + i, std::string(size, static_cast<char>('a' + i))});
  }
  return out;
}
std::string file_bytes(const std::string& path) {
  std::ostringstream text;
  text << std::ifstream(path, std::ios::binary).rdbuf();
  return text.str();
}
/// The rows that are read; whether each is one that was written.
std::size_t rows_read(MessageSource& source, const std::vector<test::WrittenMessage>& written, bool& same) {
  std::size_t rows = 0;
  source.read(
      {"/scan", "/odom"},
      [&](const BagMessage& message) {
        const std::string bytes(reinterpret_cast<const char*>(message.bytes.data()), message.bytes.size());
        same = same && rows < written.size() && message.log_time_ns == written[rows].time_ns &&
               bytes == written[rows].bytes && message.topic.name == kTwoTopics[written[rows].topic].name;
        ++rows;
      },
      {});
  return rows;
}

TEST(SqliteSource, ReadsWhatWasWrittenInItsOrder) {
  const TemporaryFolder folder;
  const auto messages = messages_of_sizes();
  test::write_db3(folder.file("a?b%20#.db3"), kTwoTopics, messages);  // signs that mean something in a URI
  const auto source = open_sqlite_bag(folder.file("a?b%20#.db3"));
  bool same = true;
  EXPECT_EQ(rows_read(*source, messages, same), 30u);
  EXPECT_TRUE(same);
  EXPECT_EQ(source->losses(), "");
  EXPECT_THAT(source->format(), HasSubstr("damage to values cannot be seen"));
  const auto topics = source->topics();
  ASSERT_EQ(topics.size(), 2u);
  EXPECT_EQ(topics[0].name, "/odom");
  EXPECT_EQ(topics[0].type, "nav_msgs/Odometry");
  EXPECT_EQ(topics[0].messages, 15u);
  std::size_t entries = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(folder.path())) ++entries;
  EXPECT_EQ(entries, 1u);  // nothing was made beside it
}

TEST(SqliteSource, AFileThatIsCutOffGivesItsFirstMessages) {
  const TemporaryFolder folder;
  const auto messages = messages_of_sizes();
  test::write_db3(folder.file("whole.db3"), kTwoTopics, messages);
  const std::string bytes = file_bytes(folder.file("whole.db3"));
  std::size_t most = 0, opened = 0;
  folder.write("cut.db3", bytes);
  for (std::size_t part = 99; part > 0; --part) {
    SCOPED_TRACE(part);
    std::filesystem::resize_file(folder.file("cut.db3"), bytes.size() * part / 100);
    bool same = true;
    try {
      const auto source = open_sqlite_bag(folder.file("cut.db3"));
      const std::size_t rows = rows_read(*source, messages, same);
      most = std::max(most, rows), ++opened;
      EXPECT_TRUE(same);
      if (rows < messages.size()) {
        EXPECT_THAT(source->losses(), HasSubstr(fmt::format("up to the {}th", rows)));
        EXPECT_THAT(source->losses(), HasSubstr("damage to values cannot be seen"));
      }
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr("cannot be read as an SQLite file of rosbag2"));
    }
  }
  EXPECT_GT(most, 25u);
  EXPECT_GT(opened, 70u);
}

TEST(SqliteSource, FlippedBytesAndOtherTablesAreTakenOrRefused) {
  const TemporaryFolder folder;
  test::write_db3(folder.file("whole.db3"), kTwoTopics, messages_of_sizes());
  const std::string bytes = file_bytes(folder.file("whole.db3"));
  for (std::size_t at = 0; at < bytes.size(); at += at < 1024 || at + 1024 >= bytes.size() ? 1 : 61) {
    std::fstream file(folder.file("whole.db3"), std::ios::in | std::ios::out | std::ios::binary);
    const auto put = [&](char byte) {
      file.seekp(static_cast<std::streamoff>(at));
      file.put(byte).flush();
    };
    put(static_cast<char>(bytes[at] ^ 1 << at % 8));
    try {
      const auto source = open_sqlite_bag(folder.file("whole.db3"));
      source->read({"/scan", "/odom"}, [](const BagMessage&) {}, {});
      source->topics();
      EXPECT_THAT(source->losses(), Not(HasSubstr("\n"))) << at;
      EXPECT_THAT(source->format(), HasSubstr("damage to values cannot be seen")) << at;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), Not(HasSubstr("\n"))) << at;
    }
    put(bytes[at]);
  }
  const auto refused = [&](const char* statements) {
    std::filesystem::remove(folder.file("other.db3"));
    sqlite3* database = nullptr;
    sqlite3_open(folder.file("other.db3").c_str(), &database);
    EXPECT_EQ(sqlite3_exec(database, statements, nullptr, nullptr, nullptr), SQLITE_OK);
    sqlite3_close(database);
    EXPECT_THROW(
        {
          const auto source = open_sqlite_bag(folder.file("other.db3"));
          source->read({"/scan"}, [](const BagMessage&) {}, {});
        },
        InputError)
        << statements;
  };
  refused("CREATE TABLE other(a)");
  // a view that never ends
  refused(
      "CREATE TABLE topics(id, name, type, serialization_format); INSERT INTO topics VALUES(1, '/scan', 't', 'cdr');"
      "CREATE VIEW messages AS WITH RECURSIVE n(i) AS (SELECT 1 UNION ALL SELECT i + 1 FROM n) SELECT i AS rowid, 1 AS "
      "topic_id, 1 AS timestamp, 'x' AS data FROM n");
  test::write_db3(folder.file("open.db3"), kTwoTopics, messages_of_sizes());
  folder.write("open.db3-journal", "not empty");
  EXPECT_THROW(open_sqlite_bag(folder.file("open.db3")), InputError);
}

// What is written but not yet in the file itself stands in the log beside it, as where a recorder was killed.
TEST(SqliteSource, ALogOfWritesBesideItIsRead) {
  const TemporaryFolder folder;
  const auto messages = messages_of_sizes();
  test::write_db3(folder.file("a.db3"), kTwoTopics, messages);
  sqlite3* database = nullptr;
  sqlite3_open(folder.file("a.db3").c_str(), &database);
  ASSERT_EQ(
      sqlite3_exec(
          database,
          "PRAGMA journal_mode = WAL; INSERT INTO messages(topic_id, timestamp, data) VALUES(1, 5, 'more')",
          nullptr, nullptr, nullptr),
      SQLITE_OK);
  for (const char* end : {"", "-wal"})
    std::filesystem::copy_file(folder.file("a.db3") + end, folder.file("killed.db3") + end);
  sqlite3_close(database);
  bool same = true;
  EXPECT_EQ(rows_read(*open_sqlite_bag(folder.file("killed.db3")), messages, same), 31u);
}

TEST(SqliteSource, FilesOfRosbag2ItselfAreRead) {
  const std::string folder = testing::recordings() + "/ros2-bags";
  RANGECAL_REQUIRE_RECORDING(folder);
  for (const char* name : {"talker.db3", "cdr_test_0.db3"}) {
    const auto topics = open_sqlite_bag(folder + "/" + name)->topics();
    ASSERT_FALSE(topics.empty()) << name;
    for (const BagTopic& topic : topics) EXPECT_EQ(topic.encoding, "cdr") << topic.name;
  }
}

}  // namespace
}  // namespace rangecal::ingest
