// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <set>

#include "closed_form/stops_line.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// The range of one cell to the landmark's axis.
struct Range {
  Vector2d stop;
  double rho = 0.0, R = 1.0;
  int place = 0;
};

/// A solution: where it ends, and by how much it misses the ranges.
struct Fit {
  Vector2d m;
  double scale = 0.0;  ///< s [m]
  double cost = std::numeric_limits<double>::infinity();
};

std::vector<double> residuals_at(const std::vector<Range>& ranges, const Vector2d& m) {
  std::vector<double> r;
  for (const Range& range : ranges) r.push_back(range.rho - (m - range.stop).norm());
  return r;
}

/// sum R (2.5 s)^2 ln(1 + (r / 2.5 s)^2) / 2, of which the weights are the derivatives by r over r.
double cost_of(const std::vector<Range>& ranges, const std::vector<double>& r, double scale) {
  const double at = 2.5 * scale;
  double cost = 0.0;
  for (std::size_t i = 0; i < r.size(); ++i)
    cost += 0.5 * ranges[i].R * at * at * std::log1p(r[i] * r[i] / (at * at));
  return cost;
}

/// Gauss-Newton with the scale of the start's residuals, renewed until the place stands.
Fit refined(const std::vector<Range>& ranges, Vector2d m) {
  constexpr int most = 50;
  constexpr double settled = 1e-9;  // of the scale
  Fit fit;
  double damping = 0.0;
  std::vector<double> r = residuals_at(ranges, m);
  const double floor = 1e-12 * std::max(ranges.front().rho, 1e-6);
  for (int iteration = 0; iteration < most; ++iteration) {
    fit.scale = std::max(robust_spread(r), floor);
    Matrix2d A = Matrix2d::Zero();
    Vector2d b = Vector2d::Zero();
    for (std::size_t i = 0; i < ranges.size(); ++i) {
      const Vector2d v = m - ranges[i].stop;
      const double distance = v.norm();
      if (!(distance > 0.0)) continue;
      const Vector2d u = v / distance;
      const double z = r[i] / (2.5 * fit.scale), w = ranges[i].R / (1.0 + z * z);
      A += w * u * u.transpose();
      b += w * r[i] * u;
    }
    const double cost = cost_of(ranges, r, fit.scale);
    const Matrix2d damped = A + damping * A.trace() * Matrix2d::Identity();
    const Vector2d step = damped.ldlt().solve(b);
    if (!step.allFinite()) break;
    std::vector<double> next = residuals_at(ranges, m + step);
    if (cost_of(ranges, next, fit.scale) <= cost) {
      m += step;
      r = std::move(next);
      damping *= 0.1;
      if (step.norm() < settled * fit.scale) break;
    } else {
      damping = std::max(10.0 * damping, 1e-3);
      if (damping > 1e6) break;
    }
  }
  fit.m = m;
  fit.scale = std::max(robust_spread(r), floor);
  return fit;
}

/// Covariance of m to first order, whatever the errors: A^-1 B A^-1 n / (n - 2), A = sum psi' u u^T, B = sum psi^2 u u^T, psi = w r
/// and psi' = R (1 - z^2) / (1 + z^2)^2 its slope, z = r / 2.5 s. Zero where A is not positive definite.
Matrix2d covariance_at(const std::vector<Range>& ranges, const Vector2d& m, double scale) {
  Matrix2d A = Matrix2d::Zero(), B = Matrix2d::Zero();
  const std::vector<double> r = residuals_at(ranges, m);
  for (std::size_t i = 0; i < ranges.size(); ++i) {
    const Vector2d u = (m - ranges[i].stop).normalized();
    const double z_sq = std::pow(r[i] / (2.5 * scale), 2), psi = ranges[i].R * r[i] / (1.0 + z_sq);
    A += ranges[i].R * (1.0 - z_sq) / ((1.0 + z_sq) * (1.0 + z_sq)) * u * u.transpose();
    B += psi * psi * u * u.transpose();
  }
  if (!(A.trace() > 0.0) || !(A.determinant() > 0.0)) return Matrix2d::Zero();
  const auto n = static_cast<double>(ranges.size());
  const Matrix2d inverse = A.inverse();
  return n / (n - 2.0) * inverse * B * inverse;
}

/// Both solutions of the linear problem; one where the stops determine the part of m across their main direction.
std::vector<Vector2d> linear_solutions(const std::vector<Range>& ranges) {
  std::vector<Vector2d> stops;
  for (const Range& range : ranges) stops.push_back(range.stop);
  const StopsLine line(stops);
  const Vector2d &centre = line.centre, &along = line.along, &across = line.across;
  Eigen::MatrixXd H(ranges.size(), 3);
  Eigen::VectorXd target(ranges.size());
  for (std::size_t k = 0; k < ranges.size(); ++k) {
    const Range& range = ranges[k];
    const Vector2d q = range.stop - centre;
    const auto row = static_cast<Eigen::Index>(k);
    const double root = std::sqrt(range.R) / std::max(range.rho, 1e-9);
    H.row(row) << -2.0 * root * q.transpose(), root;
    target[row] = root * (range.rho * range.rho - q.squaredNorm());
  }
  std::vector<Vector2d> solutions;
  if (line.across_square > 1e-12 * line.along_square) {
    const Eigen::Vector3d x = H.colPivHouseholderQr().solve(target);
    if (x.allFinite()) solutions.push_back(centre + x.head<2>());
  }
  Eigen::MatrixXd on_line(H.rows(), 2);
  on_line << H.leftCols(2) * along, H.col(2);
  const Vector2d y = on_line.colPivHouseholderQr().solve(target);
  const double off = std::sqrt(std::max(y[1] - y[0] * y[0], 0.0));
  for (const double side : {1.0, -1.0})
    solutions.push_back(centre + y[0] * along +
                        side * std::max(off, 1e-3 * std::sqrt(std::abs(y[1]))) * across);
  return solutions;
}

LandmarkFromRanges solve(const std::vector<Range>& ranges) {
  LandmarkFromRanges result;
  std::set<int> places;
  for (const Range& range : ranges) places.insert(range.place);
  if (places.size() < 3) {
    result.outcome = ranges.empty() ? Outcome::too_few_data : Outcome::unobservable;
    result.reason = ranges.empty()
                        ? "never seen"
                        : fmt::format("ranges from {} place(s) leave its place open", places.size());
    return result;
  }
  std::vector<Fit> fits;
  for (const Vector2d& start : linear_solutions(ranges)) fits.push_back(refined(ranges, start));
  double scale = std::numeric_limits<double>::infinity();
  for (const Fit& fit : fits) scale = std::min(scale, fit.scale);
  for (Fit& fit : fits) fit.cost = cost_of(ranges, residuals_at(ranges, fit.m), scale);
  const Fit& best =
      *std::min_element(fits.begin(), fits.end(), [](const Fit& a, const Fit& b) { return a.cost < b.cost; });
  const Matrix2d covariance = covariance_at(ranges, best.m, scale);
  if (!best.m.allFinite() || !std::isfinite(best.cost) || !covariance.allFinite()) {
    result.outcome = Outcome::unobservable;
    result.reason = "the stops that see it do not determine its place";
    return result;
  }
  result.outcome = Outcome::converged;
  result.position_m = best.m;
  result.covariance = covariance;
  const double dof = std::max(1.0, static_cast<double>(ranges.size()) - 2.0);
  const double variance = std::max(2.0 * best.cost / dof, scale * scale);
  for (const Fit& other : fits) {
    const bool elsewhere =
        (other.m - best.m).squaredNorm() > 25.0 * std::max(covariance.trace(), scale * scale);
    if (elsewhere && 2.0 * (other.cost - best.cost) < 9.0 * variance) result.mirror_m = other.m;
  }
  if (result.mirror_m)
    result.reason =
        fmt::format("the stops lie nearly on a line: its mirror image at ({:.3f}, {:.3f}) fits as well",
                    result.mirror_m->x(), result.mirror_m->y());
  return result;
}

}  // namespace

LandmarksFromRanges landmarks_from_ranges(const JointProblem& problem) {
  const Cells& c = problem.cells;
  std::vector<std::vector<Range>> of_landmark(static_cast<std::size_t>(problem.landmark_count()));
  for (std::size_t i = 0; i < c.size(); ++i) {
    const StopPrior& prior = problem.stops[static_cast<std::size_t>(c.stop[i])];
    of_landmark[static_cast<std::size_t>(c.landmark[i])].push_back(
        {{prior.commanded.x_m, prior.commanded.y_m},
         c.range_mean[i] + c.radius_m[i],
         c.count[i],
         prior.place});
  }
  LandmarksFromRanges result;
  result.outcome = Outcome::converged;
  bool any = false;
  for (std::size_t l = 0; l < of_landmark.size(); ++l) {
    const LandmarkFromRanges& found = result.landmarks.emplace_back(solve(of_landmark[l]));
    any = any || found.outcome == Outcome::converged;
    if (found.outcome != Outcome::converged) result.outcome = Outcome::unobservable;
    if (!found.reason.empty())
      result.reason += fmt::format("{}landmark {}: {}", result.reason.empty() ? "" : "; ", l, found.reason);
  }
  if (!any) result.outcome = Outcome::too_few_data;
  return result;
}

}  // namespace rangecal
