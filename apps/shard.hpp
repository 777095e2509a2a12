// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <charconv>
#include <string>

#include "rangecal/core/errors.hpp"

namespace rangecal::app {

/// A part of work that several runs share.
struct Shard {
  int index = 0;  ///< from 0, where the command line counts from 1
  int count = 1;
};

/// "2/8" of `--shard`: the second of eight; the only one where nothing was given. Throws InputError.
inline Shard shard_from(const std::string& text) {
  Shard shard;
  if (text.empty()) return shard;
  const char* const end = text.data() + text.size();
  const auto [slash, error] = std::from_chars(text.data(), end, shard.index);
  const bool parted = error == std::errc() && slash != end && *slash == '/';
  const auto [rest, of] = std::from_chars(parted ? slash + 1 : end, end, shard.count);
  if (!parted || of != std::errc() || rest != end || shard.index < 1 || shard.index > shard.count)
    throw InputError("--shard " + text.substr(0, 40) + ": is not I/N with 1 <= I <= N");
  --shard.index;
  return shard;
}

}  // namespace rangecal::app
