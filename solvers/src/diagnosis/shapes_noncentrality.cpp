// SPDX-License-Identifier: BSD-3-Clause
// Noncentrality of what changes neither mean nor variance: twice the Kullback-Leibler divergence per
// independent unit.
//   AR(1), correlation rho, n repeats:     -(n - 1) ln(1 - rho^2)
//   error shared in a cell, ratio q = n u^2 / s^2 of variances, one unit per cell:   q - ln(1 + q)
//   tails against the normal of their mean and variance:  2 (H_normal - H_tails) per reading (problems/tail_law.hpp)
//   skewness g of a reading:               g^2 / 6, g = 6 cv for noise before the reciprocal
//   other spread of the stops:             q - 1 - ln q per direction, q the ratio of variances of a stop's
//   estimate
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <compare>
#include <limits>
#include <map>
#include <utility>

#include "diagnosis/signatures.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal::diagnosis {
namespace {

/// Negentropies of tails by cell. They depend on the sizes of the law over the cell's standard deviation, which are rounded to a
/// twentieth of an e-fold: what that adds to and takes from single cells cancels over the cells of a recording.
class Negentropies {
 public:
  double of(const Contamination& law, double s_m) {
    constexpr double far = 15.0;  // an end so many means away is none
    const double end = law.end_m < far * std::abs(law.mean_m) ? law.end_m : 0.0;
    const Sizes sizes{law.share, place(law.extra_sigma_m / s_m), place(std::abs(law.mean_m) / s_m),
                      place(end / s_m)};
    const auto [entry, is_new] = known_.try_emplace(sizes);
    if (is_new) {
      Contamination rounded{.share = law.share,
                            .extra_sigma_m = size(sizes.extra),
                            .mean_m = std::copysign(size(sizes.mean), law.mean_m)};
      if (end > 0.0) rounded.end_m = size(sizes.end);
      TailLaw sum;
      entry->second = sum.add(rounded) ? sum.negentropy(1.0) : 0.0;
    }
    return entry->second;
  }

 private:
  static constexpr double step = 0.05;
  static constexpr int none = std::numeric_limits<int>::min();
  struct Sizes {
    double share;
    int extra, mean, end;
    auto operator<=>(const Sizes&) const = default;
  };
  static int place(double size) {
    return size > 0.0 ? static_cast<int>(std::lround(std::log(size) / step)) : none;
  }
  static double size(int place) { return place == none ? 0.0 : std::exp(step * place); }

  std::map<Sizes, double> known_;
};

/// Covariance of the stops' x (axis 0) or y (axis 1) errors under a set of priors: shared in a place, summed
/// along a chain.
Eigen::MatrixXd covariance_along(const std::vector<StopPrior>& stops, int axis) {
  const Eigen::Index n = static_cast<Eigen::Index>(stops.size());
  Eigen::MatrixXd factor = Eigen::MatrixXd::Zero(n, n);  // rows: stops, columns: independent errors
  for (Eigen::Index k = 0; k < n; ++k) {
    const StopPrior& stop = stops[static_cast<std::size_t>(k)];
    Eigen::Index home = k;
    if (!stop.opens_place)
      for (home = 0; stops[static_cast<std::size_t>(home)].place != stop.place;) ++home;
    if (home != k) {
      factor.row(k) = factor.row(home);
      continue;
    }
    if (stop.chained && k > 0) factor.row(k) = factor.row(k - 1);
    Eigen::Matrix2d own = covariance_of(stop, stop.sigma_xy_m).topLeftCorner<2, 2>();
    if (stop.chained && k > 0) {
      const Eigen::Matrix2d turn =
          Eigen::Rotation2Dd(stops[static_cast<std::size_t>(k) - 1].commanded.heading_rad).toRotationMatrix();
      own = turn * own * turn.transpose();
    }
    factor(k, k) += std::sqrt(own(axis, axis));
  }
  return factor * factor.transpose();
}

/// Means and the line through the path are the landmarks' and the curve's: a projection that leaves the rest.
Eigen::MatrixXd stop_contrasts(const Rows& rows, Eigen::Index n) {
  Eigen::MatrixXd basis(n, 2);
  for (Eigen::Index k = 0; k < n; ++k) basis.row(k) << 1.0, rows.context.path_m[static_cast<std::size_t>(k)];
  const Eigen::Matrix2d gram = basis.transpose() * basis + 1e-9 * Eigen::Matrix2d::Identity();
  const Eigen::MatrixXd projection =
      Eigen::MatrixXd::Identity(n, n) - basis * gram.inverse() * basis.transpose();
  const SymmetricEigen eigen = symmetric_eigen(projection);
  Eigen::Index first = 0;
  while (first < n && eigen.values[first] < 0.5) ++first;
  return eigen.vectors.rightCols(n - first);
}

double divergence(const Eigen::MatrixXd& with, const Eigen::MatrixXd& without) {
  double sum = 0.0;
  for (double q : symmetric_eigenvalues(with, without)) sum += q > 0.0 ? q - 1.0 - std::log(q) : 0.0;
  return sum;
}

}  // namespace

double stops_noncentrality(const Space& space, const std::vector<StopPrior>& before,
                           const std::vector<StopPrior>& after) {
  const Rows& rows = space.rows();
  const Projector& p = space.projector();
  // The first 200 stops of a longer path: what they tell is the least that all do.
  constexpr Eigen::Index most = 200;
  const Eigen::Index n = std::min<Eigen::Index>(rows.problem.stop_count(), most);
  if (n < 4) return 0.0;
  const auto first_of = [n](const std::vector<StopPrior>& stops) {
    return std::vector<StopPrior>(stops.begin(), stops.begin() + n);
  };
  Eigen::VectorXd x = Eigen::VectorXd::Constant(n, 1e-6), y = x, heading = x;
  for (int c = 0; c < p.cells(); ++c) {
    const int k = rows.problem.cells.stop[static_cast<std::size_t>(c)];
    if (k >= n) continue;
    const CellGeometry& g = p.geometry();
    const double along = p.range_information[c] * g.slope[c] * g.slope[c];
    const double across = p.bearing_information[c] / (g.axis_distance[c] * g.axis_distance[c]);
    x[k] += along * g.n[c].x() * g.n[c].x() + across * g.t[c].x() * g.t[c].x();
    y[k] += along * g.n[c].y() * g.n[c].y() + across * g.t[c].y() * g.t[c].y();
    heading[k] += p.bearing_information[c];
  }
  const Eigen::MatrixXd contrasts = stop_contrasts(rows, n);
  double sum = 0.0;
  for (int axis = 0; axis < 2; ++axis) {
    const Eigen::MatrixXd prior = covariance_along(first_of(before), axis),
                          planted = covariance_along(first_of(after), axis);
    const Eigen::MatrixXd noise = (axis == 0 ? x : y).cwiseInverse().asDiagonal();
    sum += divergence(contrasts.transpose() * (planted + noise) * contrasts,
                      contrasts.transpose() * (prior + noise) * contrasts);
  }
  for (Eigen::Index k = 0; k < n; ++k) {
    const auto variance = [&](const std::vector<StopPrior>& stops) {
      return std::pow(stops[static_cast<std::size_t>(k)].sigma_heading_rad, 2) + 1.0 / heading[k];
    };
    const double q = variance(after) / variance(before);
    sum += q - 1.0 - std::log(q);
  }
  return sum;
}

double shape_noncentrality(const Space& space, const ActiveEffect& active) {
  const Rows& rows = space.rows();
  const Projector& p = space.projector();
  const double* parameters = active.parameters.data();
  double sum = 0.0;
  const Dependence own = active.effect->dependence(parameters);
  const double cells = p.cells();
  // One unit of variance between the cells is lost per unknown of the calibration.
  const double kept = std::max(0.0, 1.0 - (p.system().layout().phi_count +
                                           2.0 * rows.problem.stop_count() * (rows.pairs ? 0.0 : 0.5)) /
                                              (2.0 * cells));
  const auto shared = [&](double sigma, const Eigen::VectorXd& information) {
    double total = 0.0;
    for (double w : information) total += w * sigma * sigma - std::log1p(w * sigma * sigma);
    return kept * total;
  };
  if (own.range_cell_sigma_m > 0.0) sum += shared(own.range_cell_sigma_m, p.range_information);
  if (own.bearing_cell_sigma_rad > 0.0) sum += shared(own.bearing_cell_sigma_rad, p.bearing_information);
  if (!rows.sequence.empty() && own.range_correlation > 0.0) {
    // Twice the divergence of the independent law from that of the sequence: of correlation matrices -ln det.
    sum -= SerialErrors(rows.sequence, own.range_correlated_share, own.range_correlation).log_determinant();
  }
  const double repeats = static_cast<double>(rows.size()) - cells;
  for (double rho : {own.range_correlation, rows.reads_bearings() ? own.bearing_correlation : 0.0})
    if (rho != 0.0) sum -= repeats * std::log1p(-std::min(rho * rho, 0.999));
  if (active.effect->info().kind == EffectKind::tail) {
    Negentropies negentropies;
    for (int c = 0; c < rows.cell_count; ++c) {  // repeats share a law
      const auto view = view_of(rows, p.geometry(), static_cast<std::size_t>(rows.cell_begin[c]));
      sum += (rows.cell_begin[c + 1] - rows.cell_begin[c]) *
             negentropies.of(active.effect->contamination(view, parameters),
                             p.geometry().spread[static_cast<std::size_t>(c)]);
    }
  }
  if (active.effect->noise_before_reciprocal())
    for (std::size_t i = 0; i < rows.size(); ++i)
      sum += 6.0 * std::pow(parameters[0] * p.geometry().d[static_cast<std::size_t>(rows.cell[i])], 2);
  if (active.effect->acts_on_stops() && !rows.pairs) {
    std::vector<StopPrior> after = rows.problem.stops;
    active.effect->stops(rows.context, parameters, after);
    bool changed = false;
    for (std::size_t k = 0; k < after.size() && !changed; ++k)
      changed = after[k].sigma_xy_m != rows.problem.stops[k].sigma_xy_m ||
                after[k].chained != rows.problem.stops[k].chained ||
                after[k].sigma_heading_rad != rows.problem.stops[k].sigma_heading_rad;
    if (changed) sum += stops_noncentrality(space, rows.problem.stops, after);
  }
  return sum;
}

}  // namespace rangecal::diagnosis
