// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/errors.hpp"

#include <gtest/gtest.h>

#include <string>

namespace rangecal {
namespace {

TEST(InputError, NamesFileRowAndColumn) {
  EXPECT_STREQ(InputError("a.csv", 3, "range_m", "is bad").what(), "a.csv, row 3, column 'range_m': is bad");
  EXPECT_STREQ(InputError("a.csv", 0, "", "is empty").what(), "a.csv: is empty");
}

TEST(InputError, IsOneLineThatATerminalMayShow) {
  EXPECT_STREQ(InputError("two\nlines \r\n").what(), "two lines");
  EXPECT_STREQ(InputError("effect \x1b[31mred\x07").what(), "effect ?[31mred?");
  EXPECT_STREQ(InputError("a.csv", 3, "x\x1b", "is \xff no number").what(),
               "a.csv, row 3, column 'x?': is ? no number");
  EXPECT_STREQ(NoAnswerError("caf\xc3\xa9").what(), "caf\xc3\xa9");
  EXPECT_LE(std::string(InputError(std::string(100000, 'x')).what()).size(), 2000u);
}

}  // namespace
}  // namespace rangecal
