// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/fingerprint.hpp"

#include <algorithm>
#include <bit>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"

namespace rangecal::app {
namespace {

namespace fs = std::filesystem;

/// Eight bytes at a time, each step one to one: whatever differs in one word differs at the end.
std::uint64_t hash_of(const fs::path& file, std::uint64_t hash) {
  std::ifstream stream(file, std::ios::binary);
  std::vector<char> block(std::size_t{1} << 16);
  while (stream) {
    stream.read(block.data(), static_cast<std::streamsize>(block.size()));
    const auto size = static_cast<std::size_t>(stream.gcount());
    for (std::size_t at = 0; at < size; at += 8) {
      std::uint64_t word = 0;
      std::memcpy(&word, block.data() + at, std::min<std::size_t>(8, size - at));
      hash = std::rotl((hash ^ word) * 0x9e3779b97f4a7c15ULL, 29);
    }
    hash ^= size;
  }
  return hash;
}

}  // namespace

std::int64_t stamp_of(const std::string& folder) {
  std::uint64_t stamp = 0;
  for (const char* file : measured_files) {
    const fs::path path = fs::path(folder) / file;
    std::error_code error;
    const std::uintmax_t size = fs::file_size(path, error);
    if (error) continue;
    const auto time = fs::last_write_time(path, error).time_since_epoch().count();
    stamp = seed_from(file, {stamp, size, static_cast<std::uint64_t>(time)});
  }
  return static_cast<std::int64_t>(stamp);
}

std::int64_t contents_of(const std::string& folder) {
  std::uint64_t contents = 0;
  for (const char* file : measured_files) {
    const fs::path path = fs::path(folder) / file;
    std::error_code error;
    if (fs::is_regular_file(path, error)) contents = hash_of(path, seed_from(file, {contents}));
  }
  return static_cast<std::int64_t>(contents);
}

std::string identity_of(const std::string& folder) {
  std::error_code error;
  const fs::path path = fs::canonical(folder, error);
  return error ? std::string() : path.string();
}

std::string place_of(const std::string& name, const std::string& identity) {
  std::error_code error;
  if (identity.empty() || fs::equivalent(name, identity, error)) return name;
  return fs::exists(identity, error) ? identity : name;
}

}  // namespace rangecal::app
