// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdio>
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
  int read = 0;
  if (std::sscanf(text.c_str(), "%d/%d%n", &shard.index, &shard.count, &read) != 2 ||
      read != static_cast<int>(text.size()) || shard.index < 1 || shard.index > shard.count)
    throw InputError("--shard " + text.substr(0, 40) + ": is not I/N with 1 <= I <= N");
  --shard.index;
  return shard;
}

}  // namespace rangecal::app
