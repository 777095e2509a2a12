// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

#include "scoring.hpp"

namespace rangecal::proof {

/// One line of the table.
struct Line {
  std::string what, required;
  int worlds = 0;
  double figure = 0.0, low = 0.0, high = 0.0;  ///< low > high: a figure without an interval
  bool met = false, percent = true;
};
/// The table of the proof from the scores of its worlds: lines for the rows that were run.
std::vector<Line> proof_lines(const std::vector<Score>& scores);

/// The table in text: lines, what was missed per row, confusion, set sizes, seconds.
std::string proof_text(const std::vector<Score>& scores, const std::map<std::string, int>& out_of_reach);

}  // namespace rangecal::proof
