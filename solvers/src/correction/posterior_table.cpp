// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/correction/posterior.hpp"

namespace rangecal {
namespace {

using Row = PosteriorTable::Row;

/// Every number of the row by `combine(a, b)`.
template <typename Combine>
Row combined(const Row& a, const Row& b, Combine combine) {
  Row row;
  row.mode_m = combine(a.mode_m, b.mode_m);
  row.mean_m = combine(a.mean_m, b.mean_m);
  row.std_dev_m = combine(a.std_dev_m, b.std_dev_m);
  row.low_m = combine(a.low_m, b.low_m);
  row.high_m = combine(a.high_m, b.high_m);
  for (int i = 0; i < PosteriorTable::max_roots; ++i) {
    row.probability[i] = combine(a.probability[i], b.probability[i]);
    row.root_m[i] = combine(a.root_m[i], b.root_m[i]);
    row.root_std_dev_m[i] = combine(a.root_std_dev_m[i], b.root_std_dev_m[i]);
  }
  return row;
}

/// Whether all that matters of `guess` is `right` within the tolerance.
bool close(const Row& guess, const Row& right, double tolerance) {
  const double width = tolerance * right.std_dev_m;
  if (!(std::abs(guess.mode_m - right.mode_m) <= width && std::abs(guess.mean_m - right.mean_m) <= width &&
        std::abs(guess.low_m - right.low_m) <= width && std::abs(guess.high_m - right.high_m) <= width &&
        std::abs(guess.std_dev_m - right.std_dev_m) <= width))
    return false;
  for (int i = 0; i < PosteriorTable::max_roots; ++i) {
    if (!(std::abs(guess.probability[i] - right.probability[i]) <= tolerance)) return false;
    if (right.probability[i] > tolerance &&
        !(std::abs(guess.root_m[i] - right.root_m[i]) <= width &&
          std::abs(guess.root_std_dev_m[i] - right.root_std_dev_m[i]) <= width))
      return false;
  }
  return true;
}

/// NaN all over.
Row no_row() {
  const Row none{};
  return combined(none, none, [](double, double) { return std::numeric_limits<double>::quiet_NaN(); });
}

}  // namespace

PosteriorTable::PosteriorTable(const Calibration& calibration, const DistancePrior& prior, int nodes,
                               double tolerance)
    : calibration_(calibration), prior_(prior), corrector_(calibration_, {}) {
  if (!calibration.effects.empty()) throw InputError("PosteriorTable: the calibration holds effects");
  if (nodes < 2 || nodes > 10000000)
    throw InputError(fmt::format("PosteriorTable: nodes = {} is outside of 2 .. 10000000", nodes));
  prior_.check();
  if (prior_.high_m == 0.0) {
    prior_.low_m = calibration_.range_min_m;
    prior_.high_m = calibration_.range_max_m;
  }
  if (!(prior_.high_m > prior_.low_m))
    throw InputError("PosteriorTable: the calibration's range_m is empty and the prior gives none");
  std::vector<double> ends = corrector_.turning_points(prior_.low_m, prior_.high_m);
  root_count_ = static_cast<int>(ends.size()) + 1;
  if (root_count_ > max_roots)
    throw InputError(
        fmt::format("PosteriorTable: the curve has {} monotone parts, more than {}", root_count_, max_roots));
  ends.push_back(prior_.low_m);
  ends.push_back(prior_.high_m);
  low_ = std::numeric_limits<double>::infinity();
  high_ = 0.0;
  constexpr double within = 3.0;  // standard deviations: readings beyond may have no posterior (4)
  for (const double d : ends) {   // all readings that the prior makes likely
    const EffectCorrector::Expected expected = corrector_.at(d, {});
    low_ = std::min(low_, expected.mean_m - within * expected.spread_m);
    high_ = std::max(high_, expected.mean_m + within * expected.spread_m);
  }
  low_ = std::max(low_, 1e-4 * high_);
  if (!(high_ > low_)) throw InputError("PosteriorTable: f is not positive over the distances of the prior");
  per_m_ = (nodes - 1) / (high_ - low_);
  for (int i = 0; i < nodes; ++i) rows_.push_back(exact(low_ + i / per_m_));
  for (int i = 0; i + 1 < nodes; ++i) {
    const Row guess = combined(rows_[i], rows_[i + 1], [](double a, double b) { return 0.5 * (a + b); });
    direct_.push_back(!close(guess, exact(low_ + (i + 0.5) / per_m_), tolerance));
  }
  // The bend beside a jump may pass a midpoint by: the neighbours of such a cell are left out with it.
  const std::vector<char> found = direct_;
  constexpr int beside = 2;
  for (int i = 0; i < static_cast<int>(found.size()); ++i)
    for (int k = std::max(0, i - beside);
         found[i] && k <= std::min<int>(i + beside, static_cast<int>(found.size()) - 1); ++k)
      direct_[k] = 1;
}

Row PosteriorTable::exact(double reading_m) const {
  const DistancePosterior posterior = distance_posterior(corrector_, reading_m, {}, prior_);
  if (posterior.outcome != Outcome::converged) return no_row();
  Row row{
      posterior.mode_m, posterior.mean_m, posterior.std_dev_m, posterior.low_m, posterior.high_m, {}, {}, {}};
  for (std::size_t i = 0; i < posterior.roots.size(); ++i) {
    row.probability[i] = posterior.roots[i].probability;
    // a root without probability has no mean: the middle of its part, so that nothing beside it is spoilt
    const double middle = 0.5 * (posterior.roots[i].from_m + posterior.roots[i].to_m);
    row.root_m[i] = std::isfinite(posterior.roots[i].mean_m) ? posterior.roots[i].mean_m : middle;
    row.root_std_dev_m[i] = std::isfinite(posterior.roots[i].std_dev_m) ? posterior.roots[i].std_dev_m : 0.0;
  }
  return row;
}

Row PosteriorTable::operator()(double reading_m) const {
  if (!(reading_m > 0.0) || !std::isfinite(reading_m)) return no_row();
  const double at = (reading_m - low_) * per_m_;
  if (!(at >= 0.0 && at < static_cast<double>(direct_.size()))) return exact(reading_m);
  const auto cell = static_cast<std::size_t>(at);
  if (direct_[cell]) return exact(reading_m);
  const double share = at - static_cast<double>(cell);
  return combined(rows_[cell], rows_[cell + 1], [share](double a, double b) { return a + share * (b - a); });
}

double PosteriorTable::exact_share() const {
  return static_cast<double>(std::count(direct_.begin(), direct_.end(), 1)) /
         static_cast<double>(direct_.size());
}

}  // namespace rangecal
