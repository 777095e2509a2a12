// SPDX-License-Identifier: BSD-3-Clause
// write_bags FOLDER: small bags of every form and single messages, for fuzzers to begin with (FOLDER/mcap, sqlite, message).
// write_bags FILE.mcap MEGABYTES: a long one, chunks of 4 MB without compression and with their checksums, a scan of 1440 beams for each
// message of odometry and nine images of 100 kB.
// write_bags FILE.mcap SCANS COMPRESSION: so many scans of 1440 beams and nothing else, by lz4, zstd or ''.
#include <cstdio>
#include <cstdlib>
#include <exception>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "support/bag_writers.hpp"

namespace {

using namespace rangecal::test;

const std::vector<WrittenTopic> kAll = {
    {"/scan", "sensor_msgs/msg/LaserScan"},     {"/odom", "nav_msgs/msg/Odometry"},
    {"/tf", "tf2_msgs/msg/TFMessage"},          {"/sonar", "sensor_msgs/msg/Range"},
    {"/pose", "geometry_msgs/msg/PoseStamped"}, {"/image", "sensor_msgs/msg/Image"}};

std::string message_of(std::size_t topic, double t, Form form) {
  if (topic == 0) return laser_scan(t, -0.4f, 0.1f, {1.0f, 1.1f, 1.2f, 1.3f, 1.4f, 1.5f, 1.6f, 1.7f}, form);
  if (topic == 1) return odometry(t, t, 0.5, 0.1, form);
  MessageWriter out(form);
  if (topic == 2)
    return out.put(std::uint32_t{1}).header(t, "odom").text("base_link").pose(t, 0.5, 0.1).bytes();
  if (topic == 3)
    return out.header(t, "sonar").put(std::uint8_t{0}).put(0.1f).put(0.1f).put(4.0f).put(1.0f).bytes();
  return pose_stamped(t, t, 0.5, 0.1, form);
}

void write_small(const std::filesystem::path& folder) {
  for (const char* name : {"mcap", "sqlite", "message"}) std::filesystem::create_directories(folder / name);
  const auto write = [&](const std::string& name, const std::string& bytes) {
    std::ofstream(folder / name, std::ios::binary) << bytes;
  };
  std::vector<WrittenMessage> messages;
  for (int i = 0; i < 4; ++i)
    for (std::size_t topic = 0; topic < 5; ++topic)
      messages.push_back({topic, 1'000'000'000LL * (i + 1), message_of(topic, i + 1.0, Form::little)});
  for (const char* compression : {"", "lz4", "zstd"})
    for (const bool checked : {false, true})
      write(std::string("mcap/chunks-") + compression + (checked ? "-crc" : ""),
            mcap_file(kAll, messages, {7, compression, checked, false, checked, true}));
  write("mcap/plain", mcap_file(kAll, messages, {0, "", false, false, false, false}));
  write("mcap/plain-crc", mcap_file(kAll, messages, {0, "", true, true, true, true}));
  std::filesystem::remove(folder / "sqlite/small");
  write_db3((folder / "sqlite/small").string(), kAll, messages);
  for (const Form form : {Form::little, Form::big, Form::ros1})
    for (std::size_t topic = 0; topic < 5; ++topic)
      write("message/" + std::to_string(static_cast<int>(form)) + "-" + std::to_string(topic),
            std::string(1, static_cast<char>(2 * topic + (form == Form::ros1 ? 1 : 0))) +
                message_of(topic, 1.0, form));
}

void write_long(const std::string& path, std::uint64_t megabytes) {
  std::ofstream file(path, std::ios::binary);
  McapWriter writer(kAll, {44});
  std::string image(100'000, '\0');
  for (std::size_t i = 0; i < image.size(); ++i) image[i] = static_cast<char>(i * i >> 3);
  const std::vector<float> ranges(1440, 2.5f);
  std::uint64_t written = 0;
  for (int i = 0; written < megabytes * 1'000'000; ++i) {
    const double t = 0.025 * i;
    const auto now = static_cast<std::int64_t>(1e9 * t);
    writer.write({0, now, laser_scan(t, -3.1f, 0.00436f, ranges)});
    writer.write({1, now, odometry(t, 0.0, 0.0, 0.0)});
    for (int k = 0; k < 9; ++k) writer.write({5, now, image});
    written += writer.bytes.size();
    file << writer.bytes;
    writer.bytes.clear();
  }
  writer.finish();
  file << writer.bytes;
}

/// Scans of 1440 beams and nothing else, a hundred to a chunk.
void write_scans(const std::string& path, int scans, const std::string& compression) {
  std::ofstream file(path, std::ios::binary);
  McapWriter writer({{"/scan", "sensor_msgs/msg/LaserScan"}}, {100, compression});
  std::vector<float> ranges(1440);
  std::uint32_t state = 1;
  for (int i = 0; i < scans; ++i) {
    for (float& range : ranges) {  // 0.2 to 4.8 m in whole millimetres
      state = state * 1664525u + 1013904223u;
      range = static_cast<float>(200 + (state >> 8) % 4600) / 1000.0f;
    }
    const double t = 0.1 * i;
    writer.write({0, static_cast<std::int64_t>(1e9 * t), laser_scan(t, -3.1f, 0.00436f, ranges)});
    file << writer.bytes;
    writer.bytes.clear();
  }
  writer.finish();
  file << writer.bytes;
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc == 2) return write_small(argv[1]), 0;
  if (argc == 3) return write_long(argv[1], std::strtoull(argv[2], nullptr, 10)), 0;
  if (argc == 4) return write_scans(argv[1], std::atoi(argv[2]), argv[3]), 0;
  return 2;
} catch (const std::exception& error) {
  std::fprintf(stderr, "write_bags: %s\n", error.what());
  return 1;
}
