// SPDX-License-Identifier: BSD-3-Clause
#include "bags/message_source.hpp"

#include <algorithm>
#include <filesystem>
#include <fstream>
#include <string_view>
#include <tuple>
#include <utility>

#include "bags/bag_folder.hpp"
#include "bags/mcap_source.hpp"
#include "bags/ros1_source.hpp"
#include "bags/sqlite_source.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

namespace fs = std::filesystem;
using std::string_view_literals::operator""sv;

constexpr std::string_view kRos1Start = "#ROSBAG", kMcapStart = "\x89MCAP",
                           kSqliteStart = "SQLite format 3\0"sv, kZstdStart = "\x28\xb5\x2f\xfd";

/// The first bytes of a regular file; nothing of what else there is, since opening a pipe may take for ever.
std::string first_bytes(const std::string& path) {
  std::error_code ignored;
  if (!fs::is_regular_file(path, ignored)) return "";
  std::string start(16, '\0');
  std::ifstream file(path, std::ios::binary);
  file.read(start.data(), static_cast<std::streamsize>(start.size()));
  start.resize(static_cast<std::size_t>(std::max<std::streamsize>(0, file.gcount())));
  return start;
}

bool is_called_bag(const std::string& path) {
  const std::string extension = fs::path(path).extension().string();
  return extension == ".mcap" || extension == ".db3";
}

}  // namespace

bool is_bag(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return true;
  const std::string start = first_bytes(path);
  for (const std::string_view known : {kRos1Start, kMcapStart, kSqliteStart, kZstdStart})
    if (start.starts_with(known)) return true;
  return fs::is_regular_file(path, ignored) && is_called_bag(path);
}

std::unique_ptr<MessageSource> open_bag(const std::string& path) {
  std::error_code ignored;
  if (fs::is_directory(path, ignored)) return open_bag_folder(path);
  if (path == "-") throw InputError("stdin", 0, "", "a bag is read from a file only");
  if (!fs::exists(path, ignored)) throw InputError(path, 0, "", "no such file");
  const std::string start = first_bytes(path);
  if (start.starts_with(kRos1Start)) return open_ros1_bag(path);
  if (start.starts_with(kMcapStart)) return open_mcap(path);
  if (start.starts_with(kSqliteStart)) return open_sqlite_bag(path);
  if (start.starts_with(kZstdStart))
    throw InputError(path, 0, "", "is compressed as a whole: unpack it by zstd -d first");
  throw InputError(path, 0, "",
                   "is no bag: its first bytes are neither MCAP's nor SQLite's nor those of a ROS 1 bag");
}

std::string type_without_msg(std::string type) {
  const std::size_t at = type.find("/msg/");
  if (at != std::string::npos) type.erase(at, 4);
  return type;
}

std::vector<BagTopic> merged(std::vector<BagTopic> topics) {
  const auto key = [](const BagTopic& topic) { return std::tie(topic.name, topic.type, topic.encoding); };
  std::stable_sort(topics.begin(), topics.end(),
                   [&](const BagTopic& a, const BagTopic& b) { return key(a) < key(b); });
  std::vector<BagTopic> out;
  for (BagTopic& topic : topics)
    if (!out.empty() && key(out.back()) == key(topic))
      out.back().messages += topic.messages;
    else
      out.push_back(std::move(topic));
  return out;
}

}  // namespace rangecal::ingest
