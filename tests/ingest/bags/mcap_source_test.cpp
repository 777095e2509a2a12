// SPDX-License-Identifier: BSD-3-Clause
#include "bags/mcap_source.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/bag_writers.hpp"
#include "support/read_mcap.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::ingest {
namespace {

using test::is_part_of;
using test::McapForm;
using test::Seen;
using test::TemporaryFolder;
using test::WrittenMessage;
using test::WrittenTopic;
using ::testing::HasSubstr;

const std::vector<WrittenTopic> kTopics = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                           {"/odom", "nav_msgs/msg/Odometry"},
                                           {"/silent", "std_msgs/msg/String"}};

/// Twelve messages of other lengths and contents in two topics.
std::vector<WrittenMessage> twelve_messages() {
  std::vector<WrittenMessage> out;
  for (int i = 0; i < 12; ++i) {
    std::string bytes;
    for (int k = 0; k < 30 + 5 * i; ++k) bytes += static_cast<char>(31 * i + 7 * k + k * k);
    out.push_back({static_cast<std::size_t>(i % 3 == 0), 1'000'000'000LL * (i + 1), bytes});
  }
  return out;
}

std::vector<std::string> as_written(const std::vector<WrittenMessage>& messages,
                                    const std::string& only = "") {
  std::vector<std::string> out;
  for (const WrittenMessage& one : messages)
    if (only.empty() || kTopics[one.topic].name == only)
      out.push_back(test::message_text(kTopics[one.topic].name, one.time_ns, one.bytes));
  return out;
}
Seen read_mcap_file(const TemporaryFolder& folder,
                    const std::vector<std::string>& names = {"/scan", "/odom"}) {
  return test::read_mcap_file(folder.file("a.mcap"), names);
}
Seen read_mcap(const TemporaryFolder& folder, const std::string& bytes,
               const std::vector<std::string>& names = {"/scan", "/odom"}) {
  folder.write("a.mcap", bytes);
  return read_mcap_file(folder, names);
}
/// A bit of a file turned over; once more, and it is as it was.
void flip(const std::string& path, std::size_t at) {
  std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
  file.seekg(static_cast<std::streamoff>(at));
  const int byte = file.get();
  file.seekp(static_cast<std::streamoff>(at));
  file.put(static_cast<char>(byte ^ 1 << at % 8));
}
std::vector<McapForm> all_forms() {
  std::vector<McapForm> forms;
  for (const std::size_t per_chunk : {std::size_t{0}, std::size_t{1}, std::size_t{5}, std::size_t{100}})
    for (const char* compression : {"", "lz4", "zstd"})
      for (const int crcs : {0, 1, 2, 3})
        for (const bool summary : {false, true})
          if (per_chunk > 0 || *compression == '\0')
            forms.push_back({per_chunk, compression, (crcs & 1) != 0, (crcs & 2) != 0, summary, crcs != 2});
  return forms;
}
std::string name_of(const McapForm& form) {
  return fmt::format("{} a chunk, '{}', crc of chunks {}, of data {}, summary {}, its crc {}", form.per_chunk,
                     form.compression, form.chunk_crc, form.data_crc, form.summary, form.summary_crc);
}

TEST(McapSource, EveryFormReadsAsItWasWritten) {
  const TemporaryFolder folder;
  const auto messages = twelve_messages();
  for (const McapForm& form : all_forms()) {
    SCOPED_TRACE(name_of(form));
    const Seen both = read_mcap(folder, test::mcap_file(kTopics, messages, form));
    EXPECT_EQ(both.messages, as_written(messages));
    EXPECT_EQ(both.losses, "");
    const bool checked = form.data_crc || (form.chunk_crc && form.per_chunk > 0);
    EXPECT_EQ(both.format == "MCAP", checked) << both.format;
    EXPECT_EQ(read_mcap(folder, test::mcap_file(kTopics, messages, form), {"/odom"}).messages,
              as_written(messages, "/odom"));
    const auto topics = open_mcap(folder.file("a.mcap"))->topics();
    ASSERT_EQ(topics.size(), 3u);
    EXPECT_EQ(topics[0].name, "/odom");
    EXPECT_EQ(topics[0].type, "nav_msgs/Odometry");
    EXPECT_EQ(topics[0].encoding, "cdr");
    EXPECT_EQ(topics[0].messages, 4u);
    EXPECT_EQ(topics[1].messages, 8u);
    EXPECT_EQ(topics[2].messages, 0u);
  }
}

TEST(McapSource, AFileThatIsCutOffGivesWhatIsThere) {
  const TemporaryFolder folder;
  const auto messages = twelve_messages();
  const auto whole = as_written(messages);
  for (const McapForm& form : all_forms()) {
    if (form.data_crc) continue;  // stands at the end, which is missing
    const std::string bytes = test::mcap_file(kTopics, messages, form);
    folder.write("a.mcap", bytes);
    std::size_t before = whole.size(), most = 0;
    for (std::size_t part = 99; part > 0; --part) {
      SCOPED_TRACE(fmt::format("{} of 100, {}", part, name_of(form)));
      const std::size_t cut = bytes.size() * part / 100;
      if (cut < 8) continue;
      std::filesystem::resize_file(folder.file("a.mcap"), cut);
      const Seen seen = read_mcap_file(folder);
      EXPECT_TRUE(is_part_of(seen.messages, whole));
      EXPECT_LE(seen.messages.size(), before);  // the less is there, the less is read
      before = seen.messages.size(), most = std::max(most, before);
      if (seen.messages.size() < whole.size()) {
        EXPECT_THAT(seen.losses, HasSubstr("the end is missing"));
      }
      EXPECT_THAT(seen.losses, ::testing::AnyOf(HasSubstr("the end is missing"),
                                                HasSubstr("summary at its end is cut off")));
      const bool checked = form.per_chunk > 0 && form.chunk_crc;
      if (!checked && !seen.messages.empty()) {
        EXPECT_THAT(seen.losses, HasSubstr("damage to values cannot be seen"));
      }
    }
    EXPECT_GE(most, form.per_chunk == 100 ? 0 : 6u) << name_of(form);
  }
}

// Of a file with checksums no flipped bit gives a message that was not written, and what is lost is said.
TEST(McapSource, NoFlippedBitGivesAWrongMessage) {
  const TemporaryFolder folder;
  const auto messages = twelve_messages();
  const auto whole = as_written(messages);
  for (const McapForm& form :
       {McapForm{5, "", true, false, true, true}, McapForm{5, "lz4", true, false, true, true},
        McapForm{5, "zstd", true, false, true, true}, McapForm{5, "", true, false, false, true},
        McapForm{5, "", false, true, true, true}, McapForm{0, "", true, true, true, true}}) {
    const std::string bytes = test::mcap_file(kTopics, messages, form);
    folder.write("a.mcap", bytes);
    int lost = 0, refused = 0;
    for (std::size_t at = 0; at < bytes.size(); ++at) {
      flip(folder.file("a.mcap"), at);
      SCOPED_TRACE(fmt::format("bit {} of byte {}, {}", at % 8, at, name_of(form)));
      try {
        const Seen seen = read_mcap_file(folder);
        EXPECT_TRUE(is_part_of(seen.messages, whole));
        if (seen.messages.size() < whole.size()) {
          ++lost;
          EXPECT_NE(seen.losses, "");
        }
        if (form.per_chunk > 0 && form.chunk_crc && form.summary) {
          EXPECT_GE(seen.messages.size(), 7u);
        }
      } catch (const InputError&) {
        ++refused;
        EXPECT_LT(at, 8u);  // the first bytes, which say what it is
      }
      flip(folder.file("a.mcap"), at);
    }
    EXPECT_GT(lost, 100) << name_of(form);
    EXPECT_EQ(refused, 8) << name_of(form);
  }
}

TEST(McapSource, WithoutChecksumsItSaysThatDamageCannotBeSeen) {
  const TemporaryFolder folder;
  const auto messages = twelve_messages();
  for (const McapForm& form :
       {McapForm{0, "", false, false, true, true}, McapForm{5, "", false, false, true, true}}) {
    const std::string bytes = test::mcap_file(kTopics, messages, form);
    folder.write("a.mcap", bytes);
    for (std::size_t at = 8; at < bytes.size(); at += 3) {
      flip(folder.file("a.mcap"), at);
      const Seen seen = read_mcap_file(folder);
      flip(folder.file("a.mcap"), at);
      if (seen.messages.empty()) continue;
      EXPECT_THAT(seen.format, HasSubstr("damage to values cannot be seen"));
    }
  }
}

TEST(McapSource, AChunkThatFailsItsChecksumIsLeftOutAndSaid) {
  const TemporaryFolder folder;
  const auto messages = twelve_messages();
  std::string bytes = test::mcap_file(kTopics, messages, {5, "", true, false, true, true});
  const std::size_t at = bytes.find(messages[6].bytes);  // in the second chunk
  bytes[at + 3] = static_cast<char>(bytes[at + 3] + 1);
  const Seen seen = read_mcap(folder, bytes);
  auto kept = as_written(messages);
  kept.erase(kept.begin() + 5, kept.begin() + 10);
  EXPECT_EQ(seen.messages, kept);
  EXPECT_THAT(seen.losses, HasSubstr("1 chunk at byte "));
  EXPECT_THAT(seen.losses, HasSubstr("fails its checksum and is left out"));
  EXPECT_THAT(seen.losses, Not(HasSubstr("cannot be seen")));

  bytes = test::mcap_file(kTopics, messages, {0, "", true, true, true, true});
  bytes[bytes.find(messages[6].bytes)] ^= 1;
  const Seen unchunked = read_mcap(folder, bytes);
  EXPECT_TRUE(unchunked.messages.empty());
  EXPECT_THAT(unchunked.losses, HasSubstr("the checksum of the file's data fails, and 12 messages"));
}

TEST(McapSource, WhatIsAnnouncedAndNotThereTakesNoMemory) {
  const TemporaryFolder folder;
  const std::string magic = "\x89MCAP0\r\n";
  const auto number = [](std::uint64_t value) { return test::raw_number(value); };
  // a chunk that says that it unpacks to 2^60 bytes, and one to 512 MB, of nothing
  for (const std::uint64_t size : {std::uint64_t{1} << 60, std::uint64_t{512} << 20})
    for (const std::string compression : {"lz4", "zstd", "none"}) {
      const std::string content = number(0) + number(0) + number(size) + std::string(4, '\0') +
                                  test::raw_number(static_cast<std::uint32_t>(compression.size())) +
                                  compression + number(3) + "abc";
      const Seen seen = read_mcap(folder, magic + '\6' + number(content.size()) + content);
      EXPECT_TRUE(seen.messages.empty());
      EXPECT_THAT(seen.losses, HasSubstr("1 chunk at byte 8 cannot be decoded"));
    }
  const Seen beyond = read_mcap(folder, magic + '\6' + number(~std::uint64_t{0}) + "abc");
  EXPECT_THAT(beyond.losses, HasSubstr("nothing is read from byte 8 of 20 on"));
}

}  // namespace
}  // namespace rangecal::ingest
