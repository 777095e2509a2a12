// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/csv_table.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/csv_rows.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

std::string error_of(const std::string& text) {
  try {
    CsvTable::parse(text, "t.csv");
  } catch (const InputError& error) {
    return error.what();
  }
  return "no error";
}

TEST(CsvTable, ReadsQuotesCrlfBomBlankLinesAndSpaces) {
  const CsvTable table = CsvTable::parse(
      "\xef\xbb\xbf"
      "a,\"b \"\"q\"\"\"\r\n 1 ,\"x,y\"\r\n\r\n2,\"two\nlines\"\r\n3,z",
      "t.csv");
  ASSERT_EQ(table.columns(), (std::vector<std::string>{"a", "b \"q\""}));
  ASSERT_EQ(table.rows(), 3u);
  EXPECT_EQ(table.number(0, 0), 1.0);
  EXPECT_EQ(table.text(0, 1), "x,y");
  EXPECT_EQ(table.text(1, 1), "two\nlines");
  EXPECT_EQ(table.text(2, 1), "z");
  // Header 1, row 2, blank 3, a row over 4 and 5, row 6.
  EXPECT_EQ(table.line(0), 2);
  EXPECT_EQ(table.line(1), 4);
  EXPECT_EQ(table.line(2), 6);
}

TEST(CsvTable, Numbers) {
  const CsvTable table = CsvTable::parse(
      "v,w\n1e-3,0\n+2.5,0\n,0\nNA,0\nnan,0\n-inf,0\n1.2x,0\n1e999,0\n0x10,0\n+-1,0\n", "t.csv");
  EXPECT_EQ(table.number(0, 0), 1e-3);
  EXPECT_EQ(table.number(1, 0), 2.5);
  EXPECT_FALSE(table.number(2, 0).has_value());
  EXPECT_FALSE(table.number(3, 0).has_value());
  EXPECT_TRUE(std::isnan(*table.number(4, 0)));
  EXPECT_TRUE(std::isinf(*table.number(5, 0)));
  for (const std::size_t row : {6u, 7u, 8u, 9u}) EXPECT_THROW(table.number(row, 0), InputError) << row;
  EXPECT_FALSE(table.is_numeric(0));
  EXPECT_TRUE(table.is_numeric(1));
  EXPECT_THROW(table.finite(2, 0), InputError);
  EXPECT_THROW(table.finite(5, 0), InputError);
  EXPECT_THROW(table.count(1, 0), InputError);
}

TEST(CsvTable, HostileInputGivesOneLineThatNamesTheRow) {
  EXPECT_EQ(error_of(""), "t.csv: is empty: a header row is expected");
  EXPECT_EQ(error_of("\xef\xbb\xbf\n\n"), "t.csv: is empty: a header row is expected");
  EXPECT_EQ(error_of("a,b\n1\n"), "t.csv, row 2: has 1 fields, the header names 2");
  EXPECT_EQ(error_of("a,b\n1,2\n1,2,3\n"), "t.csv, row 3: has 3 fields, the header names 2");
  EXPECT_EQ(error_of("a,b,a\n"), "t.csv, row 1, column 'a': the column is named twice");
  EXPECT_EQ(error_of("a,b\n1,\"open\n2,3\n"), "t.csv, row 2: a quote is opened and never closed");
  EXPECT_EQ(error_of("a,b\n1,2\"3\n"), "t.csv, row 2: a quote stands where none may");
  EXPECT_EQ(error_of(std::string("a,b\n1,\0\n", 8)), "t.csv, row 2: is not UTF-8 text");
  EXPECT_EQ(error_of("a,b\n1,\xff\xfe\n"), "t.csv, row 2: is not UTF-8 text");
  EXPECT_EQ(error_of("a,b\n1," + std::string(1u << 20, '7') + "\n"),
            "t.csv, row 2, column 'b': field 2 is longer than 4096 characters");
}

TEST(CsvRows, FieldsAreCutAtTheSeparatorGiven) {
  CsvRows bars = CsvRows::parse("a|b,c\n1,5|\"x|y\"\n", "t.csv", '|');
  ASSERT_EQ(bars.columns(), (std::vector<std::string>{"a", "b,c"}));
  ASSERT_TRUE(bars.next());
  EXPECT_EQ(bars.text(0), "1,5");
  EXPECT_EQ(bars.text(1), "x|y");
  // tabs between fields are no blanks: a row of nothing else holds empty fields
  CsvRows tabs = CsvRows::parse("a\tb\n\t\n \n\"1\"\t 2 \n", "t.csv", '\t');
  ASSERT_TRUE(tabs.next());
  EXPECT_EQ(tabs.text(0), "");
  EXPECT_EQ(tabs.text(1), "");
  ASSERT_TRUE(tabs.next());
  EXPECT_EQ(tabs.line(), 4);
  EXPECT_EQ(tabs.text(0), "1");
  EXPECT_EQ(tabs.text(1), "2");
  EXPECT_FALSE(tabs.next());
}

TEST(CsvTable, JunkNeverDoesWorseThanAnError) {
  for (std::uint64_t seed = 0; seed < 500; ++seed) {
    Random random(seed_from("CsvTable.JunkNeverDoesWorseThanAnError", {seed}));
    std::string text = "a,b\n";
    for (std::uint64_t i = 0, n = random.index(200); i < n; ++i) {
      // Half of the files are any bytes, half only those that mean something to a CSV reader.
      text += seed % 2 == 0 ? static_cast<char>(random.index(256)) : "a1,\"\n\r .-"[random.index(9)];
    }
    try {
      const CsvTable table = CsvTable::parse(text, "junk.csv");
      for (std::size_t row = 0; row < table.rows(); ++row) table.text(row, 1);
    } catch (const InputError& error) {
      EXPECT_EQ(std::string(error.what()).find('\n'), std::string::npos);
    }
  }
}

TEST(CsvTable, FieldsAreQuotedSoThatTheyReadBack) {
  for (const std::string text : {"plain", "a,b", "say \"x\"", " led", "two\nlines", "", "\"", "\xc3\xa5"}) {
    const CsvTable table = CsvTable::parse("a,b\n0," + csv_field(text) + "\n", "t.csv");
    EXPECT_EQ(table.text(0, 1), text);
  }
}

}  // namespace
}  // namespace rangecal
