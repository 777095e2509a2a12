// SPDX-License-Identifier: BSD-3-Clause
// load_speed FOLDER...: how long load_recording takes and how much memory it needs, one line a recording.
#include <fmt/core.h>
#include <sys/resource.h>

#include <chrono>
#include <cstdio>
#include <exception>

#include "rangecal/core/recording_io.hpp"

int main(int argc, char** argv) try {
  for (int i = 1; i < argc; ++i) {
    const auto begin = std::chrono::steady_clock::now();
    const rangecal::Recording recording = rangecal::load_recording(argv[i]);
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
    struct rusage usage {};
    ::getrusage(RUSAGE_SELF, &usage);
    fmt::print("{} readings, {} used: {:.2f} s, at most {} MB\n", recording.counts.read,
               recording.counts.used, seconds, usage.ru_maxrss / 1024);
  }
  return 0;
} catch (const std::exception& error) {
  fmt::print(stderr, "load_speed: {}\n", error.what());
  return 2;
}
