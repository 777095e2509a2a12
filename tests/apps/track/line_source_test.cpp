// SPDX-License-Identifier: BSD-3-Clause
#include "track/line_source.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/errors.hpp"
#include "support/open_files.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::app {
namespace {

TEST(LineSource, WhatItRefusesIsClosed) {
  const test::TemporaryFolder folder;
  const long before = test::open_files();
  EXPECT_THROW(LineSource(folder.path()), InputError);
  EXPECT_THROW(LineSource(folder.file("none")), InputError);
  EXPECT_EQ(test::open_files(), before);
  folder.write("stream.csv", "a\nb");
  {
    LineSource lines(folder.file("stream.csv"));
    std::string line;
    EXPECT_EQ(lines.next(line), LineSource::Status::line);
    EXPECT_EQ(line, "a");
    EXPECT_EQ(lines.next(line), LineSource::Status::end);
    EXPECT_EQ(lines.rest(), "b");
    EXPECT_EQ(test::open_files(), before + 1);
  }
  EXPECT_EQ(test::open_files(), before);
}

TEST(LineSource, StdinStaysOpen) {
  const long before = test::open_files();
  { const LineSource lines("-"); }
  EXPECT_EQ(test::open_files(), before);
}

}  // namespace
}  // namespace rangecal::app
