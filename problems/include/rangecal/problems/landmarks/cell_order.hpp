// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cstddef>
#include <numeric>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// True if two rows (indices into `readings`) are of one landmark from one stop.
inline bool same_cell(const Readings& readings, std::size_t a, std::size_t b) {
  return readings.stop[a] == readings.stop[b] && readings.landmark[a] == readings.landmark[b];
}

/// The rows of `readings` [size()] cell by cell: by stop, then by landmark; those of a cell as they stand in the file.
inline std::vector<std::size_t> cell_order(const Readings& readings) {
  std::vector<std::size_t> order(readings.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return readings.stop[a] != readings.stop[b] ? readings.stop[a] < readings.stop[b]
                                                : readings.landmark[a] < readings.landmark[b];
  });
  return order;
}

}  // namespace rangecal
