// SPDX-License-Identifier: BSD-3-Clause
#include "correction/stretches.hpp"

#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>

namespace rangecal {
namespace {

constexpr int samples_of_range = 96;  ///< that bound what the effects do
constexpr int parts_of_window = 16;   ///< that have a step of their own
constexpr int samples_of_part = 8;
constexpr int most_steps_of_part = 512;
constexpr double golden = 0.61803398874989485;  ///< multiples of it meet no period

double fraction(double x) { return x - std::floor(x); }

struct Window {
  double from, to;
};

/// Where |f(d) - y| <= wide.
std::vector<Window> windows_of(const Calibration& calibration, const SearchedRange& range, double y,
                               double wide) {
  std::vector<double> ends{range.low, range.high};
  for (const double edge : {y - wide, y + wide}) {
    const std::vector<double> roots = distances_at(calibration, edge, range.low, range.high);
    ends.insert(ends.end(), roots.begin(), roots.end());
  }
  std::sort(ends.begin(), ends.end());
  std::vector<Window> windows;
  for (std::size_t i = 1; i < ends.size(); ++i) {
    const double middle = 0.5 * (ends[i - 1] + ends[i]);
    if (!(ends[i] > ends[i - 1]) || std::abs(calibration.f(middle) - y) > wide) continue;
    if (!windows.empty() && windows.back().to == ends[i - 1])
      windows.back().to = ends[i];
    else
      windows.push_back({ends[i - 1], ends[i]});
  }
  return windows;
}

/// Half the size of a change over its steepest slope, as a step: of a sine, a twelfth of the period.
double step_of(const std::function<double(double)>& change, double from, double to, double h) {
  double low = 0.0, high = 0.0, steepest = 0.0;
  for (int i = 0; i < samples_of_part; ++i) {
    const double d = from + (to - from) * fraction((i + 1) * golden);
    const double at = change(d);
    low = i == 0 ? at : std::min(low, at);
    high = i == 0 ? at : std::max(high, at);
    steepest = std::max(steepest, std::abs(change(d + h) - change(d - h)) / (2.0 * h));
  }
  const double size = 0.5 * (high - low);
  return size > 0.0 && steepest > 0.0 ? 0.5 * size / steepest : to - from;
}

/// Ascending distances that resolve every change, jumps from either side.
std::vector<double> grid_of(const MeanReading& mean, const Window& window, double tiny) {
  std::vector<double> grid;
  const double part = (window.to - window.from) / parts_of_window;
  for (int p = 0; p < parts_of_window; ++p) {
    const double from = window.from + p * part;
    double step = part;
    for (const auto& change : mean.changes) step = std::min(step, step_of(change, from, from + part, tiny));
    const int steps = static_cast<int>(std::clamp(std::ceil(part / step), 1.0, 1.0 * most_steps_of_part));
    for (int i = 0; i < steps; ++i) grid.push_back(from + part * i / steps);
  }
  grid.push_back(window.to);
  for (const double jump : mean.jumps)
    for (const double d : {jump - tiny, jump + tiny})
      if (d > window.from && d < window.to) grid.push_back(d);
  std::sort(grid.begin(), grid.end());
  return grid;
}

bool jumps_between(const MeanReading& mean, double a, double b) {
  return std::any_of(mean.jumps.begin(), mean.jumps.end(), [&](double d) { return d > a && d < b; });
}

/// Cuts a window at jumps and at the extremes of g.
void cut(const MeanReading& mean, const std::vector<double>& grid, std::vector<Stretch>& stretches) {
  std::vector<double> at;
  for (const double d : grid) at.push_back(mean.at(d));
  Stretch open{grid[0], grid[0], at[0], at[0]};
  const auto close = [&](double d, double value, Stretch::End ends) {
    open.to = d;
    open.at_to = value;
    open.ends = ends;
    if (open.to > open.from) stretches.push_back(open);
    open.from = d;
    open.at_from = value;
  };
  for (std::size_t i = 1; i < grid.size(); ++i) {
    if (jumps_between(mean, grid[i - 1], grid[i])) {
      close(grid[i - 1], at[i - 1], Stretch::End::jump);
      open.from = grid[i];
      open.at_from = at[i];
      continue;
    }
    if (i + 1 == grid.size() || jumps_between(mean, grid[i], grid[i + 1])) continue;
    const bool top = at[i] > at[i - 1] && at[i] >= at[i + 1];
    const bool bottom = at[i] < at[i - 1] && at[i] <= at[i + 1];
    if (!top && !bottom) continue;
    const double side = top ? -1.0 : 1.0;
    const auto [d, value] = boost::math::tools::brent_find_minima([&](double x) { return side * mean.at(x); },
                                                                  grid[i - 1], grid[i + 1], 40);
    close(d, side * value, Stretch::End::turn);
  }
  close(grid.back(), at.back(), Stretch::End::window);
}

}  // namespace

double MeanReading::f(double d) const { return calibration.f(d); }

double MeanReading::at(double d) const {
  double sum = f(d);
  for (const auto& change : changes) sum += change(d);
  return sum;
}

std::vector<Stretch> stretches_near(const MeanReading& mean, const SearchedRange& range, double y,
                                    double reach) {
  double largest = 0.0;
  for (int i = 0; i < samples_of_range; ++i) {
    const double d = range.low + range.width() * fraction((i + 1) * golden);
    largest = std::max(largest, std::abs(mean.at(d) - mean.f(d)));
  }
  std::vector<Stretch> stretches;
  for (const Window& window : windows_of(mean.calibration, range, y, 1.5 * largest + reach))
    cut(mean, grid_of(mean, window, 1e-7 * range.width()), stretches);
  return stretches;
}

}  // namespace rangecal
