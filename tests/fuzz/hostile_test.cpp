// SPDX-License-Identifier: BSD-3-Clause
// tests/data/hostile/READER/*: what fuzzing found, and what a person would try. Every reader takes it or says
// no in one line.
#include <gtest/gtest.h>

#include <filesystem>

#include "fuzz/readers.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::fuzz {
namespace {

namespace fs = std::filesystem;
const fs::path kHostile = fs::path(RANGECAL_SOURCE_DIR) / "tests/data/hostile";

TEST(Hostile, EveryKeptInputIsTakenOrRefusedInOneLine) {
  int inputs = 0;
  for (const Reader& reader : readers()) {
    if (!fs::is_directory(kHostile / reader.name)) continue;
    for (const auto& entry : fs::directory_iterator(kHostile / reader.name)) {
      SCOPED_TRACE(entry.path().string());
      const std::string bytes = read_file(entry.path().string());
      EXPECT_NO_THROW(feed(reader, bytes));
      // cut short anywhere, it is no better
      for (std::size_t parts = 1; parts < 8; ++parts)
        EXPECT_NO_THROW(feed(reader, std::string_view(bytes).substr(0, bytes.size() * parts / 8)));
      ++inputs;
    }
  }
  EXPECT_GT(inputs, 0);
}

TEST(Hostile, EveryFolderOfInputsHasAReader) {
  for (const auto& entry : fs::directory_iterator(kHostile)) {
    bool known = false;
    for (const Reader& reader : readers()) known = known || entry.path().filename() == reader.name;
    EXPECT_TRUE(known) << entry.path();
  }
}

}  // namespace
}  // namespace rangecal::fuzz
