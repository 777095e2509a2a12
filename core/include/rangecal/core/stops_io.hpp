// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// The stops of a table like stops.csv (docs/formats.md), in its order: `stop, x_m, y_m, heading_rad`, optionally `sigma_xy_m`,
/// `sigma_heading_rad`, `place`. Throws InputError with file, row and column, for a stop listed twice and for no stop.
std::vector<Stop> stops_of(const CsvTable& table);

}  // namespace rangecal
