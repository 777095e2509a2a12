// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/gaps.hpp"

#include <algorithm>
#include <boost/math/distributions/hypergeometric.hpp>
#include <cmath>
#include <cstddef>
#include <optional>
#include <utility>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal::diagnosis {
namespace {

/// What stops see of landmarks, by the seed's curve and geometry.
class LinesOfSight {
 public:
  LinesOfSight(const JointProblem& problem, JointState seed) : problem_(problem), seed_(std::move(seed)) {}

  /// None with too few cells to say where anything is.
  static std::optional<LinesOfSight> of(const JointProblem& problem) {
    try {
      return LinesOfSight(problem, position_seed(problem, 1, NoiseLaw::f_squared));
    } catch (const InputError&) {
      return std::nullopt;
    }
  }

  /// Of landmark l from stop k [m].
  double reading(std::size_t k, std::size_t l) const {
    return evaluate_polynomial(seed_.alpha, towards(k, l).norm() - problem_.landmark_radius_m[l]);
  }

  /// True if any part of landmark l stands behind a nearer one, within what stop k's stated position is uncertain by:
  ///
  ///   |b_m - b_l| < asin(R_m / d_m) + asin(R_l / d_l) + sigma_xy (1 / d_m - 1 / d_l),   d_m < d_l
  ///     b direction, d distance of the axis [m] from the stop, R radius [m]
  bool hidden(std::size_t k, std::size_t l) const {
    const Eigen::Vector2d own = towards(k, l);
    const double d = own.norm();
    for (std::size_t m = 0; m < problem_.landmark_radius_m.size(); ++m) {
      if (problem_.landmark_recording[m] != problem_.landmark_recording[l]) continue;
      if (problem_.landmark_radius_m[m] == 0.0) continue;  // a point hides nothing
      const Eigen::Vector2d other = towards(k, m);
      const double nearer = other.norm();
      if (!(nearer < d)) continue;
      const double apart = wrap_angle(std::atan2(other.y(), other.x()) - std::atan2(own.y(), own.x()));
      if (std::abs(apart) <
          half_width(m, nearer) + half_width(l, d) + problem_.stops[k].sigma_xy_m * (1.0 / nearer - 1.0 / d))
        return true;
    }
    return false;
  }

 private:
  Eigen::Vector2d towards(std::size_t k, std::size_t l) const {
    return seed_.landmarks[l] - Eigen::Vector2d(seed_.stops[k].x_m, seed_.stops[k].y_m);
  }
  double half_width(std::size_t l, double distance) const {
    return std::asin(std::min(1.0, problem_.landmark_radius_m[l] / distance));
  }

  const JointProblem& problem_;
  JointState seed_;
};

/// Stops and landmarks without a single reading, where stops see nearly all. Empty where seeing few is the rule.
std::vector<std::pair<std::size_t, std::size_t>> unseen_of(const JointProblem& problem,
                                                           const LinesOfSight& lines) {
  constexpr double nearly_all = 0.8;
  const Cells& cells = problem.cells;
  const std::size_t landmarks = problem.landmark_recording.size();
  std::vector<char> seen(problem.stops.size() * landmarks, 0), landmark_seen(landmarks, 0),
      stop_sees(problem.stops.size(), 0);
  for (std::size_t i = 0; i < cells.size(); ++i) {
    const auto stop = static_cast<std::size_t>(cells.stop[i]),
               l = static_cast<std::size_t>(cells.landmark[i]);
    seen[stop * landmarks + l] = landmark_seen[l] = stop_sees[stop] = 1;
  }
  std::vector<std::pair<std::size_t, std::size_t>> unseen;
  for (std::size_t k = 0; k < problem.stops.size(); ++k)
    for (std::size_t l = 0; l < landmarks; ++l)
      if (stop_sees[k] && landmark_seen[l] && !seen[k * landmarks + l] &&
          problem.landmark_recording[l] == problem.stops[k].recording && !lines.hidden(k, l))
        unseen.emplace_back(k, l);
  const auto count = static_cast<double>(cells.size() + unseen.size());
  if (static_cast<double>(cells.size()) < nearly_all * count) unseen.clear();
  return unseen;
}

}  // namespace

Gaps gaps_of(const Rows& rows) {
  constexpr double enough = 12.5;  // nats
  // Close to the limit that the sensor states readings are missing by that limit, and cells were left out for it.
  constexpr double close = 0.85;
  Gaps gaps;
  if (!rows.reads_bearings() || rows.context.largest_cell < 3) return gaps;
  const std::vector<int>&stop = rows.problem.cells.stop, &landmark = rows.problem.cells.landmark;
  const auto count_of = [&](int c) -> double { return rows.cell_begin[c + 1] - rows.cell_begin[c]; };
  std::vector<double> full(rows.problem.stops.size(), 0.0), emptiest = full;
  for (int c = 0; c < rows.cell_count; ++c) {
    emptiest[stop[c]] = full[stop[c]] > 0.0 ? std::min(emptiest[stop[c]], count_of(c)) : count_of(c);
    full[stop[c]] = std::max(full[stop[c]], count_of(c));
  }
  for (std::size_t k = 0; k < full.size(); ++k)
    if (emptiest[k] < full[k]) full[k] = rows.context.largest_cell;
  struct Cell {
    double reading, missing, full;
  };
  std::vector<Cell> cells;
  const auto add = [&](double reading, double missing, double all) {
    if (missing == 0.0 || reading < close * rows.range_max_m) cells.push_back({reading, missing, all});
  };
  bool any = rows.cell_count < static_cast<int>(full.size() * rows.problem.landmark_recording.size());
  for (int c = 0; c < rows.cell_count && !any; ++c) any = count_of(c) < full[stop[c]];
  if (!any) return gaps;
  const std::optional<LinesOfSight> lines = LinesOfSight::of(rows.problem);
  for (int c = 0; c < rows.cell_count; ++c)
    if (!lines || !lines->hidden(static_cast<std::size_t>(stop[c]), static_cast<std::size_t>(landmark[c])))
      add(rows.problem.cells.range_mean[c], full[stop[c]] - count_of(c), full[stop[c]]);
  if (lines)
    for (const auto& [k, l] : unseen_of(rows.problem, *lines)) add(lines->reading(k, l), full[k], full[k]);
  unsigned with_gaps = 0;
  for (const Cell& cell : cells) {
    gaps.missing += cell.missing;
    gaps.expected += cell.full;
    if (cell.missing > 0.0) ++with_gaps;
  }
  std::sort(cells.begin(), cells.end(), [](const Cell& a, const Cell& b) { return a.reading > b.reading; });
  const auto log_likelihood = [](double missing, double all) {
    const auto part = [&](double k) { return k > 0.0 ? k * std::log(k / all) : 0.0; };
    return part(missing) + part(all - missing);
  };
  const auto count = static_cast<unsigned>(cells.size());
  const double one_rate = log_likelihood(gaps.missing, gaps.expected) + std::log(static_cast<double>(count));
  double beyond = 0.0, far = 0.0;
  unsigned gaps_beyond = 0;
  for (unsigned k = 1; k < count; ++k) {  // the k farthest cells
    beyond += cells[k - 1].missing;
    far += cells[k - 1].full;
    if (!(cells[k - 1].missing > 0.0)) continue;  // a limit just beyond this cell is likelier
    ++gaps_beyond;
    const unsigned fewest = with_gaps + k > count ? with_gaps + k - count : 0;
    const double near = gaps.expected - far;
    const double gain = log_likelihood(beyond, far) + log_likelihood(gaps.missing - beyond, near) - one_rate;
    if (gaps_beyond <= fewest || gain < enough || beyond * near <= (gaps.missing - beyond) * far) continue;
    // A landmark that somebody stood in front of loses many readings at once: cells count, not readings.
    const boost::math::hypergeometric law(with_gaps, k, count);
    const double chance = boost::math::cdf(boost::math::complement(law, gaps_beyond - 1.0));
    if (chance < gaps.chance) gaps.chance = chance, gaps.gain = gain, gaps.from_m = cells[k - 1].reading;
  }
  return gaps;
}

}  // namespace rangecal::diagnosis
