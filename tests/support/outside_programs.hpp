// SPDX-License-Identifier: BSD-3-Clause
// Readers and writers of MCAP that are not ours: the scripts of tests/ingest/bags/outside, with what npm installed for them.
#pragma once

#include <gtest/gtest.h>

#include <cstdlib>
#include <fstream>
#include <iterator>
#include <string>

#include "support/temporary_folder.hpp"

/// Ends a test that needs them where they are not there.
#define RANGECAL_REQUIRE_OUTSIDE()                                                                             \
  do {                                                                                                         \
    if (std::string(RANGECAL_OUTSIDE).empty())                                                                 \
      GTEST_SKIP()                                                                                             \
          << "node, npm or the packages of tests/ingest/bags/outside were not there when this was configured"; \
  } while (false)

namespace rangecal::test {

/// What a script prints; fails the test where it does not end well.
inline std::string run_outside(const std::string& script, const std::string& arguments) {
  const TemporaryFolder folder;
  const std::string command = std::string(RANGECAL_NODE) + " " + RANGECAL_OUTSIDE + "/" + script + " " +
                              arguments + " > " + folder.file("out") + " 2> " + folder.file("err");
  const int status = std::system(command.c_str());
  const auto text = [&](const char* name) {
    std::ifstream stream(folder.file(name), std::ios::binary);
    return std::string(std::istreambuf_iterator<char>(stream), {});
  };
  EXPECT_EQ(status, 0) << text("err");
  return text("out");
}

}  // namespace rangecal::test
