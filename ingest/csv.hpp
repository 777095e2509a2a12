// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <string>
#include <vector>

namespace rangecal::ingest {

/// What the header of someone's own table does not say: which column is what, units, and how its texts are to be read.
/// What is empty is found by the rules stated in csv.cpp.
struct TableOptions {
  std::string source, truth, reading, batch, landmark, bearing, time;
  std::string unit, true_unit, reading_unit, bearing_unit, time_unit;
  std::string separator, decimal, name;
  std::vector<std::string> missing;
  int skip = 0;
  bool says_something() const;  ///< some option was given
};

/// The options that `import csv` and `correct` have in common, in a group of --help where one is named.
void add_table_options(CLI::App& command, TableOptions& given, const std::string& group = "");

/// Someone's own table of readings without true distances.
struct ReadingsTable {
  /// As 'correct' reads it: reading_m, what there is of time_s, landmark, batch and bearing_rad, and every other column by the
  /// name that 'import csv' gives it; each row in the line that it had.
  std::string csv;
  /// Its header and its rows that are not blank, as they were, their fields apart by `separator`.
  std::vector<std::string> lines;
  std::vector<std::string> columns;   ///< the table's own
  std::string words;                  ///< which columns were taken as what, in one line
  std::vector<std::string> warnings;  ///< what speaks against that
  char separator = ',';
  bool decimal_commas = false;
};

/// Reads `text`, which stands in messages as given.source. The reading is the column given, or reading_m or range_m, or the one
/// whose name says that it is one. Throws InputError as 'import csv' does. Cost: linear in the text.
ReadingsTable read_readings(TableOptions given, std::string text);

}  // namespace rangecal::ingest
