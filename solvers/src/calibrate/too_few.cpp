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
    return fmt::format("{} place(s) to stand: lines of sight have no redundancy with fewer than 3",
                       places.size());
  const double unknowns = order + 1 + 2.0 * problem.landmark_count();
  if (2.0 * static_cast<double>(problem.cells.size()) < unknowns + 2.0)
    return fmt::format("{} cells of range and bearing for {} unknowns of curve and landmarks",
                       problem.cells.size(), unknowns);
  if (static_cast<int>(problem.cells.size()) < order + 2)
    return fmt::format("{} distances for a curve of order {}", problem.cells.size(), order);
  return std::nullopt;
}

}  // namespace rangecal
