// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/format.h>

#include <algorithm>
#include <cstdint>
#include <string>
#include <vector>

#include "bags/mcap_source.hpp"

namespace rangecal::test {

/// What was read: topic, time and bytes of each message as one text, and what was said about the rest.
struct Seen {
  std::vector<std::string> messages;
  std::string losses, format;
};
inline std::string message_text(const std::string& topic, std::int64_t time, const std::string& bytes) {
  return fmt::format("{} {} {}", topic, time, bytes);
}
inline Seen read_mcap_file(const std::string& path, const std::vector<std::string>& names) {
  const auto source = ingest::open_mcap(path);
  Seen seen;
  source->read(names,
               [&](const ingest::BagMessage& message) {
                 seen.messages.push_back(message_text(
                     message.topic.name, message.log_time_ns,
                     std::string(reinterpret_cast<const char*>(message.bytes.data()), message.bytes.size())));
               },
               {});
  seen.losses = source->losses(), seen.format = source->format();
  return seen;
}

/// True if `part` holds messages of `whole` in their order and no other.
inline bool is_part_of(const std::vector<std::string>& part, const std::vector<std::string>& whole) {
  auto at = whole.begin();
  for (const std::string& one : part) {
    at = std::find(at, whole.end(), one);
    if (at == whole.end()) return false;
    ++at;
  }
  return true;
}

}  // namespace rangecal::test
