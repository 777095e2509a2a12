// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <filesystem>
#include <iterator>

namespace rangecal::test {

/// How many files this process has open, and the listing itself.
inline long open_files() {
  return std::distance(std::filesystem::directory_iterator("/proc/self/fd"),
                       std::filesystem::directory_iterator());
}

}  // namespace rangecal::test
