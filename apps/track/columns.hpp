// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string>

namespace rangecal::app {

/// Which fields of a stream's lines hold what; -1 where there is no such column. Without a header the one
/// field of a line is the reading.
struct Columns {
  int reading = 0, truth = -1, time = -1;
  std::size_t count = 1;
};

/// From the header: reading_m or range_m, true_m, time_s. Throws InputError naming file and line where no
/// column holds the reading.
Columns columns_of(const std::string& header, const std::string& file, long line);

}  // namespace rangecal::app
