// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <filesystem>
#include <string>

/// Ends a test that needs the recording or file `path` where it is not there: skipped, or failed where RANGECAL_REQUIRE_DATA
/// is set. tests/skipped.cmake counts those that say so in these words.
#define RANGECAL_REQUIRE_RECORDING(path)                                                      \
  do {                                                                                        \
    if (!std::filesystem::exists(path)) {                                                     \
      if (rangecal::testing::recordings_required()) FAIL() << "missing recording " << (path); \
      GTEST_SKIP() << "missing recording " << (path);                                         \
    }                                                                                         \
  } while (false)

namespace rangecal::testing {

/// The folder of real recordings, which are not part of the project.
inline std::string recordings() {
  const char* given = std::getenv("RANGECAL_RECORDINGS");
  return given ? given : std::string(RANGECAL_SOURCE_DIR) + "/../shared/recordings";
}

inline bool recordings_required() {
  const char* required = std::getenv("RANGECAL_REQUIRE_DATA");
  return required && std::string(required) != "" && std::string(required) != "0";
}

}  // namespace rangecal::testing
