// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/core.h>
#include <unistd.h>

#include <cstdio>
#include <filesystem>
#include <functional>
#include <string>

namespace rangecal::app {

/// How far a long file is read, on stderr where that is a terminal: each hundredth once.
inline std::function<void(const std::string& file, double share)> progress_on_terminal() {
  if (::isatty(STDERR_FILENO) == 0) return {};
  return [shown = -1](const std::string& file, double share) mutable {
    const int now = static_cast<int>(100.0 * share);
    if (now == shown) return;
    shown = now;
    const std::string words = "reading " + std::filesystem::path(file).filename().string();
    if (now < 100)
      fmt::print(stderr, "\rrangecal: {} {:3} %", words, now);
    else
      fmt::print(stderr, "\r{:{}}\r", "", words.size() + 20);
    std::fflush(stderr);
  };
}

}  // namespace rangecal::app
