// SPDX-License-Identifier: BSD-3-Clause
// Bags by writers that are not ours (tests/ingest/bags/outside/write.mjs), of recordings of real scanners.
#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <sstream>
#include <string>
#include <vector>

#include "bags/bag_scans.hpp"
#include "bags/mcap_source.hpp"
#include "rangecal/core/errors.hpp"
#include "support/outside_programs.hpp"
#include "support/read_mcap.hpp"
#include "support/recordings.hpp"
#include "support/scan_logs.hpp"

namespace rangecal::ingest {
namespace {

using test::is_part_of;
using test::read_mcap_file;
using test::Seen;
using test::TemporaryFolder;
using ::testing::AllOf;
using ::testing::HasSubstr;
using ::testing::Not;

const std::vector<std::string> kNames = {"/scan", "/odom", "/tf"};

struct OutsideForm {
  const char* name;
  const char* options;
};
const OutsideForm kForms[] = {
    {"zstd", R"("compression": "zstd", "chunks": true, "index": true, "bigEndian": false)"},
    {"lz4, big endian", R"("compression": "lz4", "chunks": true, "index": true, "bigEndian": true)"},
    {"not compressed, big endian", R"("compression": "", "chunks": true, "index": true, "bigEndian": true)"},
    {"lz4, no index", R"("compression": "lz4", "chunks": true, "index": false, "bigEndian": false)"},
    {"zstd, no index", R"("compression": "zstd", "chunks": true, "index": false, "bigEndian": true)"},
    {"no chunks", R"("compression": "", "chunks": false, "index": true, "bigEndian": false)"}};

/// What the writer says that it wrote.
std::vector<std::string> written_to(const std::string& path) {
  std::ifstream stream(path + ".messages", std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(stream), {}};
  std::vector<std::string> out;
  for (std::size_t at = 0; at < bytes.size();) {
    const auto length = static_cast<std::size_t>(static_cast<unsigned char>(bytes[at]));
    const std::string topic = bytes.substr(at + 1, length);
    std::int64_t time = 0;
    std::uint32_t size = 0;
    std::memcpy(&time, bytes.data() + at + 1 + length, 8),
        std::memcpy(&size, bytes.data() + at + 9 + length, 4);
    out.push_back(test::message_text(topic, time, bytes.substr(at + 13 + length, size)));
    at += 13 + length + size;
  }
  return out;
}

class OutsideWriter : public ::testing::Test {
 protected:
  void SetUp() override {
    RANGECAL_REQUIRE_OUTSIDE();
    RANGECAL_REQUIRE_RECORDING(table("lds02-wall"));
  }
  static std::string table(const std::string& recording) {
    return testing::recordings() +
           (recording == "lds02-wall" ? "/lds02-wall/g3_1.0m.csv" : "/rplidar-a2-room/scans.csv");
  }
  std::string write(const std::string& recording, const OutsideForm& form, int scans) const {
    const std::string path = folder.file("outside.mcap");
    test::run_outside("write.mjs", fmt::format("{} {} '{{\"scans\": {}, {}}}'", table(recording), path, scans,
                                               form.options));
    return path;
  }
  TemporaryFolder folder;
};

TEST_F(OutsideWriter, WhatItWroteIsReadBitForBit) {
  for (const char* recording : {"lds02-wall", "rplidar-a2-room"})
    for (const OutsideForm& form : kForms) {
      SCOPED_TRACE(fmt::format("{}, {}", recording, form.name));
      const std::string path = write(recording, form, 60);
      const std::vector<std::string> written = written_to(path);
      ASSERT_EQ(written.size(), 180u);
      const Seen seen = read_mcap_file(path, kNames);
      EXPECT_EQ(seen.messages, written);
      EXPECT_EQ(seen.losses, "");
      EXPECT_EQ(seen.format, "MCAP");  // with checksums
      const auto topics = open_mcap(path)->topics();
      ASSERT_EQ(topics.size(), 3u);
      for (const BagTopic& topic : topics) EXPECT_EQ(topic.messages, 60u) << topic.name;
    }
}

// Ranges, bearings and stamps are those of the table, as float32 and to the microsecond that it has; poses those that write.mjs makes up.
TEST_F(OutsideWriter, ItsScansAreThoseOfTheTable) {
  for (const char* recording : {"lds02-wall", "rplidar-a2-room"})
    for (const OutsideForm& form : {kForms[0], kForms[1]})
      for (const char* poses : {"/odom", "/tf"}) {
        SCOPED_TRACE(fmt::format("{}, {}, {}", recording, form.name, poses));
        const ScanLog log = test::read_bag_scans(write(recording, form, 30), {"/scan", poses, "", {}});
        EXPECT_EQ(log.warning, "");
        ASSERT_EQ(log.scans.size(), 30u);
        std::ifstream lines(table(recording));
        std::string line, field;
        std::getline(lines, line);
        for (std::size_t s = 0; s < log.scans.size(); ++s) {
          const Scan& scan = log.scans[s];
          std::getline(lines, line);
          std::istringstream fields(line);
          const auto next = [&] {
            return std::getline(fields, field, ',') ? std::stod(field) : std::nan("");
          };
          EXPECT_NEAR(scan.stamp_s, next(), 1e-6);
          const float from = static_cast<float>(next()), step = static_cast<float>(next());
          ASSERT_EQ(scan.size(), static_cast<std::size_t>(next()));
          for (std::size_t i = 0; i < scan.size(); ++i) {
            const double range = static_cast<double>(static_cast<float>(next()));
            if (Scan::returned(range) && range >= static_cast<double>(0.05f)) {
              EXPECT_EQ(scan.range_m[i], range);
            } else {
              EXPECT_FALSE(Scan::returned(scan.range_m[i]));
            }
            EXPECT_NEAR(scan.bearing_rad[i],
                        static_cast<double>(from) + static_cast<double>(step) * static_cast<double>(i),
                        1e-12);
          }
          ASSERT_TRUE(scan.odometry);
          EXPECT_NEAR(scan.odometry->x_m, 0.01 * static_cast<double>(s), 1e-12);
          EXPECT_NEAR(scan.odometry->y_m, -0.02 * static_cast<double>(s), 1e-12);
          EXPECT_NEAR(scan.odometry->heading_rad, 0.05 * static_cast<double>(s), 1e-12);
        }
      }
}

TEST_F(OutsideWriter, OfAFileThatIsCutOffTheFirstMessagesAreRead) {
  for (const OutsideForm& form : kForms) {
    const std::string path = write("lds02-wall", form, 60);
    const std::vector<std::string> written = written_to(path);
    const std::size_t whole = std::filesystem::file_size(path);
    std::size_t before = written.size(), most = 0;
    for (std::size_t part = 100; part-- > 1;) {
      SCOPED_TRACE(fmt::format("{} of 100, {}", part, form.name));
      std::filesystem::resize_file(path, whole * part / 100);
      const Seen seen = read_mcap_file(path, kNames);
      ASSERT_LE(seen.messages.size(), before);
      before = seen.messages.size(), most = std::max(most, before);
      EXPECT_TRUE(std::equal(seen.messages.begin(), seen.messages.end(), written.begin()));
      EXPECT_THAT(seen.losses, AllOf(Not(HasSubstr("\n")), Not(::testing::IsEmpty())));
    }
    EXPECT_GT(most, written.size() / 2) << form.name;
  }
}

// Each byte of the first and last kilobyte turned over. Every file has checksums: no message comes out that was not written.
TEST_F(OutsideWriter, NoFlippedByteGivesAWrongMessage) {
  for (const OutsideForm& form : kForms) {
    const std::string path = write("rplidar-a2-room", form, 30);
    const std::vector<std::string> written = written_to(path);
    const std::size_t size = std::filesystem::file_size(path),
                      kilobyte = std::min<std::size_t>(1024, size / 2);
    std::fstream file(path, std::ios::in | std::ios::out | std::ios::binary);
    for (std::size_t k = 0; k < 2 * kilobyte; ++k) {
      const std::size_t at = k < kilobyte ? k : size - 2 * kilobyte + k;
      SCOPED_TRACE(fmt::format("byte {}, {}", at, form.name));
      const auto flip = [&] {
        file.seekg(static_cast<std::streamoff>(at));
        const int byte = file.get();
        file.seekp(static_cast<std::streamoff>(at));
        file.put(static_cast<char>(byte ^ 0xff)).flush();
      };
      flip();
      try {
        const Seen seen = read_mcap_file(path, kNames);
        ASSERT_TRUE(is_part_of(seen.messages, written));
        EXPECT_THAT(seen.losses, Not(HasSubstr("\n")));
        if (seen.messages.size() < written.size()) {
          EXPECT_NE(seen.losses, "");
        }
      } catch (const InputError& error) {  // a line and exit code 2
        EXPECT_LT(at, 8u);                 // the first bytes say what the file is
        EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
      }
      flip();
    }
  }
}

}  // namespace
}  // namespace rangecal::ingest
