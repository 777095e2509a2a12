// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/plausibility.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

namespace rangecal {
namespace {

std::string unit_warning(const Calibration& calibration) {
  constexpr double most = 20.0;
  const double d = 0.5 * (calibration.range_min_m + calibration.range_max_m);
  if (calibration.alpha.size() == 0 || !(d > 0.0) || calibration.scale.is_reciprocal() ||
      !(calibration.slope(d) > 0.0))
    return {};
  const double factor = std::abs(calibration.f(d)) / d;
  if (!std::isfinite(factor) || (factor < most && factor * most > 1.0)) return {};
  const bool pairs = calibration.kind == RecordingKind::pairs;
  const char *read = pairs ? "reading_m is" : "range_m is",
             *known = pairs ? "true_m is" : "stops (or taped distances) are";
  return fmt::format(
      "at a distance of {:.4g} m the curve reads {:.4g} m: if the sensor reports metres, {} in another unit",
      d, factor * d, factor > 1.0 ? read : known);
}

/// Of ranges or bearings: "" where a cell has two that differ, or hardly any cell has two.
std::string repeat_warning(std::span<const Recording> recordings, bool bearings) {
  constexpr int fewest = 5;  // cells with repeats
  int repeated = 0;
  for (const Recording& recording : recordings) {
    std::map<std::pair<int, int>, std::pair<double, int>> first;
    const Readings& r = recording.readings;
    if (bearings && !r.has_bearings()) continue;
    for (std::size_t i = 0; i < r.size(); ++i) {
      const double value = bearings ? r.bearing_rad[i] : r.range_m[i];
      auto& [of_cell, count] = first.try_emplace({r.stop[i], r.landmark[i]}, value, 0).first->second;
      if (value != of_cell) return {};
      repeated += ++count == 2;
    }
  }
  if (repeated < fewest) return {};
  return fmt::format(
      "the repeats of every {} are the same to the last digit: a simulation without noise, or steps far coarser than "
      "the noise; no spread can be estimated from such readings, and the answer may be far off",
      bearings ? "bearing" : "range");
}

}  // namespace

std::string range_limit_warning(std::span<const Recording> recordings) {
  int read = 0, above = 0;
  for (const Recording& recording : recordings) {
    read += recording.counts.read;
    const auto found = recording.counts.dropped.find("above range_max_m");
    if (found != recording.counts.dropped.end()) above += found->second;
  }
  if (2 * above <= read) return {};
  return fmt::format("{} of {} readings lie above range_max_m ({:g} m): are they in metres?", above, read,
                     recordings[0].sensor.range_max_m);
}

std::string noise_shape_warning(const Calibration& calibration) {
  constexpr int enough = 100;
  const int used = calibration.counts.used;
  if (calibration.noise_shapes.empty() || used <= 0 || used >= enough) return {};
  return fmt::format(
      "{} readings are few for a noise shape estimated along: intervals are too narrow (95 % intervals of 30 pairs held "
      "f in 85 to 90 % and sigma_e in 80 %); from {} readings on they hold",
      used, enough);
}

std::vector<std::string> plausibility_warnings(std::span<const Recording> recordings,
                                               const Calibration& calibration) {
  std::vector<std::string> all;
  for (const Recording& recording : recordings)
    for (const std::string& note : recording.notes)
      if (std::find(all.begin(), all.end(), note) == all.end()) all.push_back(note);
  for (std::string one :
       {range_limit_warning(recordings), unit_warning(calibration), repeat_warning(recordings, false),
        repeat_warning(recordings, true), noise_shape_warning(calibration)})
    if (!one.empty()) all.push_back(std::move(one));
  return all;
}

std::optional<int> order_without_noise(const JointProblem& problem, int lowest, int highest) {
  constexpr double rounding = 1e-9;
  const Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i)
    if (std::sqrt(c.range_mean_square[i]) > rounding * c.range_mean[i] ||
        (problem.reads_bearings && std::sqrt(c.bearing_mean_square[i]) > rounding))
      return std::nullopt;
  for (int order = lowest; order <= highest && c.size() > static_cast<std::size_t>(order) + 3; ++order) {
    JointState state;
    try {
      ClosedFormOptions options;
      options.order = order;
      options.noise_law = NoiseLaw::constant;
      state = closed_form_state(problem, options);
    } catch (const InputError&) {
      return std::nullopt;
    }
    bool exact = true;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const Pose2& pose = state.stops[static_cast<std::size_t>(c.stop[i])];
      const Eigen::Vector2d away =
          state.landmarks[static_cast<std::size_t>(c.landmark[i])] - Eigen::Vector2d(pose.x_m, pose.y_m);
      const double bearing = std::atan2(away.y(), away.x()) - pose.heading_rad;
      if (problem.reads_bearings && !(std::abs(wrap_angle(c.bearing_mean[i] - bearing)) < rounding))
        return std::nullopt;  // landmarks are where the bearings put them, at any order
      const double f = evaluate_polynomial(state.alpha, away.norm() - c.radius_m[i]);
      exact = exact && std::abs(f - c.range_mean[i]) < rounding * c.range_mean[i];
    }
    if (exact) return order;
  }
  return std::nullopt;
}

std::string without_noise(int order) {
  return fmt::format(
      "a curve of order {} passes through every reading, and so do the lines of sight: there is no noise, "
      "sigma goes to 0 and the likelihood has no maximum; give a simulation's readings noise",
      order);
}

}  // namespace rangecal
