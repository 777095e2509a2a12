// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/too_few.hpp"

#include <fmt/core.h>

#include <set>

namespace rangecal {

std::optional<std::string> why_too_few(const JointProblem& problem, int order) {
  std::set<int> places;
  for (int stop : problem.cells.stop) places.insert(problem.stops[stop].place);
  if (problem.readings < 1.0) return "no usable reading";
  if (places.size() < 3)
    return fmt::format("{} place(s) to stand: lines of sight and ranges have no redundancy with fewer than 3",
                       places.size());
  const double unknowns = order + 1 + 2.0 * problem.landmark_count();
  const double of_cell = problem.reads_bearings ? 2.0 : 1.0;
  if (of_cell * static_cast<double>(problem.cells.size()) < unknowns + of_cell)
    return fmt::format("{} cells of {} for {} unknowns of curve and landmarks", problem.cells.size(),
                       problem.reads_bearings ? "range and bearing" : "ranges alone", unknowns);
  if (static_cast<int>(problem.cells.size()) < order + 2)
    return fmt::format("{} distances for a curve of order {}", problem.cells.size(), order);
  return std::nullopt;
}

}  // namespace rangecal
