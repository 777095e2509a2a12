// SPDX-License-Identifier: BSD-3-Clause
#include "bags/bag_correction.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <filesystem>
#include <fstream>
#include <limits>
#include <map>
#include <string>
#include <vector>

#include "bags/bag_copy.hpp"
#include "bags/message_source.hpp"
#include "bags/ros_messages.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"
#include "support/bag_writers.hpp"
#include "support/calibration_of.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::ingest {
namespace {

namespace fs = std::filesystem;
using rangecal::testing::calibration_of;
using test::Form;
using test::McapForm;
using test::TemporaryFolder;
using test::WrittenMessage;
using test::WrittenTopic;
using ::testing::HasSubstr;

const std::vector<WrittenTopic> kBag = {{"/scan", "sensor_msgs/msg/LaserScan"},
                                        {"/odom", "nav_msgs/msg/Odometry"},
                                        {"/range", "sensor_msgs/msg/Range"}};
const float kInf = std::numeric_limits<float>::infinity(), kNan = std::numeric_limits<float>::quiet_NaN();

BagCorrectionOptions topic(const std::string& name, const std::string& keep_raw = "") {
  BagCorrectionOptions options;
  options.topic = name, options.keep_raw = keep_raw;
  return options;
}

/// f(d) = 0.1 + 0.9 d over 0.5 to 4 m: d = (y - 0.1) / 0.9.
Calibration line() { return calibration_of(Eigen::Vector2d(0.1, 0.9), NoiseLaw::constant, 0.001, 0.5, 4.0); }

std::string range_message(double stamp_s, float range, Form form = Form::little) {
  test::MessageWriter out(form);
  return out.header(stamp_s, "sonar").put(std::uint8_t{1}).put(0.3f).put(0.1f).put(8.0f).put(range).bytes();
}

/// Limits of laser_scan(): 0.05 to 20 m.
const std::vector<float> kReadings = {1.0f, 2.8f, kInf, kNan, 0.0f, -kInf, 25.0f, 0.04f, 3.9f, 0.55f, 9.0f};

std::vector<WrittenMessage> three_topics(Form form = Form::little) {
  std::vector<WrittenMessage> out;
  for (int i = 0; i < 9; ++i) {
    const double t = 100.0 + 0.1 * i;
    const auto time = static_cast<std::int64_t>(1e9 * t);
    auto readings = kReadings;
    readings[0] += 0.01f * static_cast<float>(i);
    out.push_back({0, time, test::laser_scan(t, -1.0f, 0.1f, readings, form)});
    out.push_back({1, time + 1, test::odometry(t, 0.1 * i, 0.0, 0.2, form)});
    out.push_back({2, time + 2, range_message(t, 1.9f, form)});
  }
  return out;
}

struct Message {
  std::string topic;
  std::int64_t time;
  std::string bytes;
  bool operator==(const Message&) const = default;
};
std::vector<Message> all_messages(const std::string& path) {
  const auto source = open_bag(path);
  std::vector<std::string> names;
  for (const BagTopic& topic : source->topics()) names.push_back(topic.name);
  std::vector<Message> out;
  source->read(names,
               [&](const BagMessage& m) {
                 out.push_back({m.topic.name, m.log_time_ns,
                                std::string(reinterpret_cast<const char*>(m.bytes.data()), m.bytes.size())});
               },
               {});
  EXPECT_EQ(source->losses(), "");
  EXPECT_TRUE(source->format() == "MCAP" || source->format().starts_with("SQLite")) << source->format();
  return out;
}
std::vector<Message> of_topic(const std::vector<Message>& all, const std::string& topic) {
  std::vector<Message> out;
  for (const Message& one : all)
    if (one.topic == topic) out.push_back(one);
  return out;
}
LaserScanMessage scan_of(const std::string& bytes, Wire wire = Wire::cdr) {
  return read_laser_scan({reinterpret_cast<const std::byte*>(bytes.data()), bytes.size()}, wire);
}
std::string slurped(const std::string& path) {
  std::ifstream stream(path, std::ios::binary);
  return {std::istreambuf_iterator<char>(stream), {}};
}
std::size_t files_in(const TemporaryFolder& folder) {
  const fs::path here = fs::path(folder.file("x")).parent_path();
  return static_cast<std::size_t>(std::distance(fs::directory_iterator(here), fs::directory_iterator()));
}

void expect_corrected(const std::vector<float>& before, const std::vector<float>& after) {
  ASSERT_EQ(before.size(), after.size());
  const auto d = [](float y) { return static_cast<float>((static_cast<double>(y) - 0.1) / 0.9); };
  for (std::size_t i = 0; i < before.size(); ++i) {
    SCOPED_TRACE(fmt::format("beam {}", i));
    if (i == 10) {
      EXPECT_TRUE(std::isnan(after[i]));  // 9 m are read at no distance up to 4.35 m
    } else if (i >= 2 && i <= 7) {
      EXPECT_EQ(std::memcmp(&before[i], &after[i], sizeof(float)), 0);  // no return: the very bits
    } else {
      EXPECT_NEAR(after[i], d(before[i]), 3e-7f);  // a last bit of a float at 4 m
    }
  }
}

TEST(CorrectBag, EveryFormOfMcap) {
  const TemporaryFolder folder;
  for (const Form form : {Form::little, Form::big, Form::ros1})
    for (const std::size_t per_chunk : {std::size_t{0}, std::size_t{1}, std::size_t{5}, std::size_t{100}})
      for (const char* compression : {"", "lz4", "zstd"})
        for (const int crcs : {0, 1, 3})
          for (const bool summary : {false, true}) {
            if (per_chunk == 0 && *compression != '\0') continue;
            SCOPED_TRACE(fmt::format("{} {} '{}' {} {}", static_cast<int>(form), per_chunk, compression, crcs,
                                     summary));
            auto topics = kBag;
            if (form == Form::ros1)
              for (WrittenTopic& topic : topics) topic.encoding = "ros1";
            const auto messages = three_topics(form);
            folder.write("in.mcap", test::mcap_file(topics, messages,
                                                    {per_chunk, compression, (crcs & 1) != 0, (crcs & 2) != 0,
                                                     summary, true}));
            BagCorrectionOptions options;
            options.topic = "/scan", options.keep_raw = "/scan_raw";
            const BagCorrected found =
                correct_bag(line(), "cal.json", folder.file("in.mcap"), folder.file("out.mcap"), options);
            EXPECT_EQ(found.warning, "");
            EXPECT_EQ(found.messages, 9u);
            EXPECT_EQ(found.readings, 99u);
            EXPECT_EQ(found.corrected, 36u);
            EXPECT_EQ(found.kept, 54u);
            EXPECT_EQ(found.without_distance, 9u);
            const bool checked = (crcs & 2) != 0 || ((crcs & 1) != 0 && per_chunk > 0);
            EXPECT_EQ(found.format == "MCAP", checked);
            const auto before = all_messages(folder.file("out.mcap"));
            ASSERT_EQ(before.size(), 36u);
            std::vector<Message> others, scans, raw;
            for (const WrittenMessage& one : messages)
              (one.topic == 0 ? raw : others)
                  .push_back({one.topic == 0 ? "/scan_raw" : topics[one.topic].name, one.time_ns, one.bytes});
            std::vector<Message> others_found;
            for (const Message& one : before)
              if (one.topic == "/odom" || one.topic == "/range") others_found.push_back(one);
            EXPECT_EQ(others_found, others);
            EXPECT_EQ(of_topic(before, "/scan_raw"), raw);
            scans = of_topic(before, "/scan");
            ASSERT_EQ(scans.size(), raw.size());
            const Wire wire = form == Form::ros1 ? Wire::ros1 : Wire::cdr;
            for (std::size_t i = 0; i < scans.size(); ++i) {
              const LaserScanMessage was = scan_of(raw[i].bytes, wire), is = scan_of(scans[i].bytes, wire);
              expect_corrected(was.range_m, is.range_m);
              EXPECT_EQ(scans[i].time, raw[i].time);
              EXPECT_EQ(is.intensity, was.intensity);
              EXPECT_EQ(is.stamp_s, was.stamp_s);
              EXPECT_EQ(scans[i].bytes.size(), raw[i].bytes.size());
            }
          }
}

TEST(CorrectBag, RangesOfSonars) {
  const TemporaryFolder folder;
  auto messages = three_topics();
  messages.push_back({2, 200'000'000'000, range_message(200.0, kInf)});
  folder.write("in.mcap", test::mcap_file(kBag, messages, {4, "lz4"}));
  BagCorrectionOptions options;
  options.topic = "/range";
  const BagCorrected found =
      correct_bag(line(), "c", folder.file("in.mcap"), folder.file("out.mcap"), options);
  EXPECT_EQ(found.corrected, 9u);
  EXPECT_EQ(found.kept, 1u);
  const auto ranges = of_topic(all_messages(folder.file("out.mcap")), "/range");
  ASSERT_EQ(ranges.size(), 10u);
  const auto range_in = [](const Message& one) {
    return read_range({reinterpret_cast<const std::byte*>(one.bytes.data()), one.bytes.size()}, Wire::cdr);
  };
  EXPECT_NEAR(range_in(ranges[0]).range_m, 2.0f, 3e-7f);  // (1.9 - 0.1) / 0.9
  EXPECT_EQ(range_in(ranges[0]).max_range_m, 8.0f);
  EXPECT_EQ(ranges[9].bytes, messages.back().bytes);
}

TEST(CorrectBag, SqliteIsCopiedTableByTable) {
  const TemporaryFolder folder;
  const auto messages = three_topics(Form::big);
  test::write_db3(folder.file("in.db3"), kBag, messages);
  BagCorrectionOptions options;
  options.topic = "/scan", options.keep_raw = "/scan_raw";
  const BagCorrected found = correct_bag(line(), "c", folder.file("in.db3"), folder.file("out.db3"), options);
  EXPECT_EQ(found.corrected, 36u);
  EXPECT_THAT(found.format, HasSubstr("damage to values cannot be seen"));
  const auto all = all_messages(folder.file("out.db3"));
  ASSERT_EQ(all.size(), 36u);
  std::size_t at = 0;
  for (const WrittenMessage& one : messages) {
    EXPECT_EQ(all[at].topic, kBag[one.topic].name);
    EXPECT_EQ(all[at].time, one.time_ns);
    if (one.topic != 0) {
      EXPECT_EQ(all[at].bytes, one.bytes);
    } else {
      expect_corrected(scan_of(one.bytes).range_m, scan_of(all[at].bytes).range_m);
    }
    ++at;
  }
  const auto raw = of_topic(all, "/scan_raw");
  ASSERT_EQ(raw.size(), 9u);
  EXPECT_EQ(raw[0].bytes, messages[0].bytes);
  EXPECT_THROW(correct_bag(line(), "c", folder.file("out.db3"), folder.file("again.db3"), topic("/scan")),
               InputError);
  EXPECT_FALSE(fs::exists(folder.file("again.db3")));
}

// By effects of the bearing every beam gets what EffectCorrector says of its bearing, also where beams run clockwise.
TEST(CorrectBag, EffectsOfTheBearingAreUndone) {
  const TemporaryFolder folder;
  Calibration c = line();
  c.effects["range_eccentricity"] = {{"cosine_m", 0.02}, {"sine_m", -0.015}};
  std::vector<float> readings;
  for (int i = 0; i < 60; ++i) readings.push_back(1.0f + 0.03f * static_cast<float>(i));
  std::vector<WrittenMessage> messages;
  for (int i = 0; i < 3; ++i)
    messages.push_back(
        {0, i, test::laser_scan(1.0 + i, -1.5f + 0.01f * static_cast<float>(i), 0.0501f, readings)});
  folder.write("in.mcap", test::mcap_file({kBag[0]}, messages, {2, "zstd"}));
  for (const bool clockwise : {false, true}) {
    BagCorrectionOptions options;
    options.clockwise = clockwise;
    const BagCorrected found = correct_bag(c, "c", folder.file("in.mcap"), folder.file("out.mcap"), options);
    EXPECT_EQ(found.topic, "/scan");
    EXPECT_EQ(found.corrected, 180u);
    const EffectCorrector corrector(c, {});
    for (const Message& one : all_messages(folder.file("out.mcap"))) {
      const LaserScanMessage is = scan_of(one.bytes);
      for (std::size_t i = 0; i < is.range_m.size(); ++i) {
        ReadingSetting setting;
        setting.bearing_rad =
            (clockwise ? -1.0 : 1.0) * (static_cast<double>(is.angle_min_rad) +
                                        static_cast<double>(i) * static_cast<double>(is.angle_increment_rad));
        const Correction exact = corrector.correct(readings[i], setting);
        ASSERT_EQ(exact.least_squares.size(), 1u);
        EXPECT_NEAR(is.range_m[i], exact.least_squares[0].distance_m, 3e-7);
      }
    }
  }
}

TEST(CorrectBag, DriftCountsFromTheFirstMessage) {
  const TemporaryFolder folder;
  Calibration c = line();
  c.effects["warmup_drift"] = {{"offset_m", 0.02}, {"curvature_per_m", 0.0}, {"time_s", 10.0}};
  std::vector<WrittenMessage> messages;
  for (int i = 0; i < 3; ++i)
    messages.push_back({0, i, test::laser_scan(500.0 + 10.0 * i, 0.0f, 0.1f, {1.9f, 1.9f})});
  folder.write("in.mcap", test::mcap_file({kBag[0]}, messages, {2, ""}));
  correct_bag(c, "c", folder.file("in.mcap"), folder.file("out.mcap"), {});
  const auto scans = all_messages(folder.file("out.mcap"));
  for (std::size_t i = 0; i < 3; ++i)  // 0.02 (1 - exp(-t / 10 s)) more is read at t = 10 i
    EXPECT_NEAR(scan_of(scans[i].bytes).range_m[1],
                (1.8 - 0.02 * (1.0 - std::exp(-static_cast<double>(i)))) / 0.9, 1e-6);
}

TEST(CorrectBag, WhatCannotBeDoneIsRefusedAndLeavesNothing) {
  const TemporaryFolder folder;
  folder.write("in.mcap", test::mcap_file(kBag, three_topics(), {4, "lz4"}));
  folder.write("empty.mcap", test::mcap_file(kBag, {}, {4, "lz4"}));
  folder.write("odd.mcap", test::mcap_file(kBag, {{0, 5, "no message"}}, {4, "lz4"}));
  const std::size_t before = files_in(folder);
  const auto refused = [&](const Calibration& c, const std::string& in, const BagCorrectionOptions& options,
                           const std::string& word) {
    try {
      correct_bag(c, "cal.json", folder.file(in), folder.file("out.mcap"), options);
      ADD_FAILURE() << word;
    } catch (const InputError& error) {
      EXPECT_THAT(error.what(), HasSubstr(word));
      EXPECT_THAT(error.what(), Not(HasSubstr("\n")));
    }
    EXPECT_EQ(files_in(folder), before);
  };
  refused(line(), "in.mcap", {}, "choose one of its topics by --topic: /range, /scan");
  refused(line(), "in.mcap", topic("/none"), "holds no topic /none");
  refused(line(), "in.mcap", topic("/odom"), "is of nav_msgs/Odometry");
  refused(line(), "in.mcap", topic("/scan", "/odom"), "has a topic /odom already");
  refused(line(), "empty.mcap", topic("/scan"), "holds no readable message of /scan");
  refused(line(), "odd.mcap", topic("/scan"), "no message of /scan can be used");
  Calibration by_landmark = line();
  by_landmark.labels = {"A", "B"};
  by_landmark.effects["dark_target"] = {{"landmark", 0.0}, {"log_variance", 1.4}};
  refused(by_landmark, "in.mcap", topic("/scan"), "needs landmark to be undone");
  correct_bag(line(), "c", folder.file("in.mcap"), folder.file("once.mcap"), topic("/scan"));
  EXPECT_THROW(correct_bag(line(), "c", folder.file("once.mcap"), folder.file("out.mcap"), topic("/scan")),
               InputError);
  EXPECT_FALSE(fs::exists(folder.file("out.mcap")));
  EXPECT_EQ(
      correct_bag(line(), "c", folder.file("once.mcap"), folder.file("out.mcap"), topic("/range")).corrected,
      9u);
}

// What a damaged bag gives is what was readable, corrected, and a line; nothing that fails a checksum.
TEST(CorrectBag, OfADamagedBagWhatIsReadable) {
  const TemporaryFolder folder;
  const auto messages = three_topics();
  folder.write("whole.mcap", test::mcap_file(kBag, messages, {4, "lz4"}));
  const std::string bytes = slurped(folder.file("whole.mcap"));
  BagCorrectionOptions options;
  options.topic = "/scan", options.keep_raw = "/scan_raw";
  correct_bag(line(), "c", folder.file("whole.mcap"), folder.file("reference.mcap"), options);
  const auto reference = all_messages(folder.file("reference.mcap"));
  const auto is_part = [&](const std::vector<Message>& part) {
    auto at = reference.begin();
    for (const Message& one : part) {
      at = std::find(at, reference.end(), one);
      if (at == reference.end()) return false;
      ++at;
    }
    return true;
  };
  int whole = 0, part = 0, refused = 0;
  const auto check = [&](const std::string& damaged, const std::string& name) {
    SCOPED_TRACE(name);
    folder.write("in.mcap", damaged);
    fs::remove(folder.file("out.mcap"));
    try {
      const BagCorrected found =
          correct_bag(line(), "c", folder.file("in.mcap"), folder.file("out.mcap"), options);
      const auto got = all_messages(folder.file("out.mcap"));
      EXPECT_TRUE(is_part(got));
      ++(got.size() == reference.size() ? whole : part);
      if (got.size() < reference.size()) {
        EXPECT_NE(found.warning, "");
        EXPECT_THAT(found.warning, Not(HasSubstr("\n")));
      }
    } catch (const InputError& error) {
      ++refused;
      EXPECT_FALSE(fs::exists(folder.file("out.mcap")));
    }
  };
  for (std::size_t at = 0; at < bytes.size(); at += at < 1024 || at + 1024 > bytes.size() ? 3 : 37) {
    std::string damaged = bytes;
    damaged[at] = static_cast<char>(damaged[at] ^ 1 << at % 8);
    check(damaged, fmt::format("bit {} of byte {}", at % 8, at));
  }
  for (std::size_t cut = 1; cut < 100; ++cut)
    check(bytes.substr(0, bytes.size() * cut / 100), fmt::format("{} %", cut));
  EXPECT_GT(whole, 100);
  EXPECT_GT(part, 100);
  EXPECT_GT(refused, 0);
}

TEST(CorrectBag, AttachmentsAndMetadataStay) {
  const TemporaryFolder folder;
  std::string bytes = test::mcap_file(kBag, three_topics(), {4, "zstd", true, false, false, true});
  const auto text = [](const std::string& words) {
    return test::raw_number(static_cast<std::uint32_t>(words.size())) + words;
  };
  const auto record = [](int opcode, const std::string& content) {
    return static_cast<char>(opcode) + test::raw_number(std::uint64_t{content.size()}) + content;
  };
  const std::string attached(700'000, 'q');
  std::string attachment = test::raw_number(std::uint64_t{7}) + test::raw_number(std::uint64_t{8}) +
                           text("map.pgm") + text("image/x-pgm") +
                           test::raw_number(std::uint64_t{attached.size()}) + attached;
  attachment += test::raw_number(test::crc32_of(attachment));
  const std::string metadata = record(0x0c, text("robot") + text(text("name") + text("r2")));
  const std::size_t end_of_header = 8 + 9 + 4 + 4 + 4 + 14;
  bytes.insert(end_of_header, record(0x09, attachment) + metadata + record(0x90, "private"));
  folder.write("in.mcap", bytes);
  EXPECT_EQ(
      correct_bag(line(), "c", folder.file("in.mcap"), folder.file("out.mcap"), topic("/scan")).corrected,
      36u);
  const std::string out = slurped(folder.file("out.mcap"));
  EXPECT_THAT(out, HasSubstr(record(0x09, attachment)));
  EXPECT_THAT(out, HasSubstr(metadata));
  EXPECT_THAT(out, HasSubstr(record(0x90, "private")));
  EXPECT_THAT(out, HasSubstr("rangecal correct"));
  EXPECT_THAT(out, HasSubstr("map.pgm"));
}

}  // namespace
}  // namespace rangecal::ingest
