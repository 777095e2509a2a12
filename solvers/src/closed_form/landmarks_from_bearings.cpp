// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"

#include <fmt/format.h>

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "closed_form/moments.hpp"
#include "closed_form/stop_variance.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/names.hpp"

namespace rangecal {
namespace {

constexpr auto weights_names =
    names_of<BearingWeights>("kind of bearing weights", {{BearingWeights::paper, "paper"},
                                                         {BearingWeights::printed, "printed"},
                                                         {BearingWeights::consistent, "consistent"}});

constexpr double initial_sigma_theta = 0.02;  // [rad], where nothing repeats and none is given

/// One line of sight.
struct Sight {
  Eigen::Vector2d stop, along, across;  ///< across = (sin phi, -cos phi)
  double R = 1.0, d = 0.0;              ///< repeats; measured distance to the axis [m]
  StopVariance of_stop;
  double own_sq = 0.0,
         own_h_sq = 0.0;          ///< without what a random walk brought from earlier stops [m^2, rad^2]
  double reading_variance = 0.0;  ///< var(d~) of the cell mean [m^2]
  int landmark = 0;
};

std::vector<Sight> sights_of(const JointProblem& problem, const BearingOptions& options) {
  const Cells& cells = problem.cells;
  std::vector<Sight> sights(cells.size());
  const std::vector<StopVariance> stop_variance = stop_variances(problem, options.sigma_s_m);
  double ratio = 0.0;
  int with_repeats = 0;
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const StopPrior& prior = problem.stops[cells.stop[c]];
    const double phi = prior.commanded.heading_rad + cells.bearing_mean[c];
    Sight& s = sights[c];
    s.stop = {prior.commanded.x_m, prior.commanded.y_m};
    s.along = {std::cos(phi), std::sin(phi)};
    s.across = {std::sin(phi), -std::cos(phi)};
    s.R = cells.count[c];
    s.d = cells.range_mean[c] + cells.radius_m[c];
    s.of_stop = stop_variance[cells.stop[c]];
    s.own_sq = std::pow(prior.shape ? prior.sigma_xy_m : options.sigma_s_m.value_or(prior.sigma_xy_m), 2);
    s.own_h_sq = std::pow(prior.sigma_heading_rad, 2);
    s.landmark = cells.landmark[c];
    if (s.R >= 2.0) {
      s.reading_variance = cells.range_mean_square[c] / (s.R - 1.0);
      ratio += s.reading_variance * s.R / std::pow(s.d, 4);
      ++with_repeats;
    }
  }
  const double c4 = with_repeats > 0 && ratio > 0.0 ? ratio / with_repeats : 1e-4;
  for (Sight& s : sights) {
    if (!(s.reading_variance > 0.0)) s.reading_variance = c4 * std::pow(s.d, 4) / s.R;
  }
  return sights;
}

double residual_variance(const Sight& s, double sigma_theta_sq) {
  return s.of_stop.off_line(s.across, s.d) + sigma_theta_sq / s.R * s.d * s.d;
}

double weight_of(const Sight& s, BearingWeights weights, double sigma_theta_sq) {
  switch (weights) {
    case BearingWeights::paper:
      return 1.0 / s.reading_variance;
    case BearingWeights::printed:
      return s.of_stop.along(s.across) + sigma_theta_sq / s.reading_variance;
    default:
      return 1.0 / std::max(residual_variance(s, sigma_theta_sq), 1e-300);
  }
}

std::string direction_text(const Eigen::Vector2d& direction) {
  return fmt::format("({:.3f}, {:.3f})", direction.x(), direction.y());
}

/// Of bearings: as used, and as told by the repeats alone, without what lines that miss each other add [rad^2].
struct BearingVariance {
  double used = 0.0, of_repeats = 0.0;
};

/// What parallel lines would make of the noise: mean square of their directions [rad^2].
double scatter_of_directions(const std::vector<const Sight*>& sights, double sigma_theta_sq) {
  double sum = 0.0;
  for (const Sight* s : sights) sum += s->own_sq / (s->d * s->d) + sigma_theta_sq / s->R + s->own_h_sq;
  return sum / static_cast<double>(sights.size());
}

/// Why lines whose directions spread by less than 1.5 times their noise determine nothing along `weakest`.
std::string why_parallel(const std::vector<const Sight*>& sights, double spread_sq,
                         const BearingVariance& bearing, const Eigen::Vector2d& weakest) {
  const std::string where = "not determined along " + direction_text(weakest);
  if (spread_sq < std::max(1e-13, 2.25 * scatter_of_directions(sights, bearing.of_repeats)))
    return "its lines of sight are parallel: " + where;
  constexpr double degrees = 180.0 / std::numbers::pi;
  return fmt::format(
      "its lines of sight do not meet: stops and bearings disagree by {:.0f} degrees where the lines' directions "
      "differ by {:.0f}: {}",
      degrees * std::sqrt(bearing.used), degrees * std::sqrt(spread_sq), where);
}

LandmarkFromBearings solve(const std::vector<const Sight*>& sights, BearingWeights weights,
                           const BearingVariance& bearing) {
  const double sigma_theta_sq = bearing.used;
  LandmarkFromBearings result;
  result.cells = static_cast<int>(sights.size());
  if (sights.size() < 2) {
    result.outcome = sights.empty() ? Outcome::too_few_data : Outcome::unobservable;
    result.reason = sights.empty() ? "never seen" : "seen from one stop only";
    result.condition = std::numeric_limits<double>::infinity();
    if (!sights.empty()) {
      result.weakest_direction = sights.front()->along;
      result.reason += ": not determined along " + direction_text(result.weakest_direction);
    }
    return result;
  }
  const double n = static_cast<double>(sights.size());
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();
  double scale = 0.0;
  for (const Sight* s : sights) {
    centre += s->stop / n;
    scale = std::max(scale, weight_of(*s, weights, sigma_theta_sq));
  }
  Eigen::Matrix2d spread = Eigen::Matrix2d::Zero(), A = spread, M = spread;
  Eigen::Vector2d b = Eigen::Vector2d::Zero();
  for (const Sight* s : sights) {
    const double w = weight_of(*s, weights, sigma_theta_sq) / scale;
    const Eigen::Matrix2d hh = s->across * s->across.transpose();
    spread += hh / n;
    A += w * hh;
    M += w * w * residual_variance(*s, sigma_theta_sq) * hh;
    b += w * s->across * s->across.dot(s->stop - centre);
  }
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> of_spread, of_A;
  of_spread.computeDirect(spread);
  of_A.computeDirect(A);
  result.weakest_direction = of_A.eigenvectors().col(0);
  result.condition = of_A.eigenvalues()(0) > 0.0 ? std::sqrt(of_A.eigenvalues()(1) / of_A.eigenvalues()(0))
                                                 : std::numeric_limits<double>::infinity();
  const double spread_sq = of_spread.eigenvalues()(0);
  if (spread_sq < std::max(1e-13, 2.25 * scatter_of_directions(sights, sigma_theta_sq))) {
    result.weakest_direction = of_spread.eigenvectors().col(0);
    result.outcome = Outcome::unobservable;
    result.reason = why_parallel(sights, spread_sq, bearing, result.weakest_direction);
    return result;
  }
  const Eigen::Matrix2d A_inverse = A.inverse();
  result.position_m = centre + A_inverse * b;
  result.covariance = A_inverse * M * A_inverse;
  int ahead = 0;
  for (const Sight* s : sights) ahead += s->along.dot(result.position_m - s->stop) > 0.0 ? 1 : -1;
  if (ahead <= 0) {
    result.outcome = Outcome::unobservable;
    result.reason = "its lines of sight meet behind the stops: not determined along " +
                    direction_text(result.weakest_direction);
    return result;
  }
  result.outcome = Outcome::converged;
  return result;
}

/// sigma_theta^2 from the angles between the lines and the landmarks found, and from the repeats; 0 if there
/// are no degrees of freedom or nothing is left for it.
double sigma_theta_sq_from(const JointProblem& problem, const std::vector<Sight>& sights,
                           const std::vector<LandmarkFromBearings>& landmarks) {
  std::vector<MomentTerm> terms;
  double within = 0.0, dof = 0.0;
  for (std::size_t c = 0; c < sights.size(); ++c) {
    const Sight& s = sights[c];
    within += s.R * problem.cells.bearing_mean_square[c];
    dof += s.R - 1.0;
    if (landmarks[s.landmark].outcome != Outcome::converged) continue;
    const Eigen::Vector2d v = landmarks[s.landmark].position_m - s.stop;
    const double angle = std::atan2(s.along.x() * v.y() - s.along.y() * v.x(), s.along.dot(v));
    terms.push_back({angle * angle, 1.0 / s.R, s.of_stop.off_line(s.across, v.norm()) / v.squaredNorm()});
    dof += 1.0;
  }
  for (const LandmarkFromBearings& l : landmarks) dof -= l.outcome == Outcome::converged ? 2.0 : 0.0;
  return variance_from_moments(terms, within, dof);
}

double sigma_theta_sq_within(const JointProblem& problem) {
  double within = 0.0, dof = 0.0;
  for (std::size_t c = 0; c < problem.cells.size(); ++c) {
    within += problem.cells.count[c] * problem.cells.bearing_mean_square[c];
    dof += problem.cells.count[c] - 1.0;
  }
  return dof > 0.0 && within > 0.0 ? within / dof : initial_sigma_theta * initial_sigma_theta;
}

}  // namespace

const char* to_string(BearingWeights weights) { return weights_names.name_of(weights); }

BearingWeights bearing_weights_from_string(const std::string& text) { return weights_names.value_of(text); }

LandmarksFromBearings landmarks_from_bearings(const JointProblem& problem, const BearingOptions& options) {
  const std::vector<Sight> sights = sights_of(problem, options);
  std::vector<std::vector<const Sight*>> of_landmark(problem.landmark_count());
  for (const Sight& s : sights) of_landmark[s.landmark].push_back(&s);

  LandmarksFromBearings result;
  double sigma_theta_sq =
      options.sigma_theta_rad ? std::pow(*options.sigma_theta_rad, 2) : sigma_theta_sq_within(problem);
  const double of_repeats = sigma_theta_sq;
  const auto solve_all = [&] {
    result.landmarks.clear();
    for (const auto& lines : of_landmark)
      result.landmarks.push_back(solve(lines, options.weights, {sigma_theta_sq, of_repeats}));
  };
  solve_all();
  const auto any_found = [&] {
    return std::any_of(result.landmarks.begin(), result.landmarks.end(),
                       [](const LandmarkFromBearings& l) { return l.outcome == Outcome::converged; });
  };
  for (int pass = 0; pass < 2 && !options.sigma_theta_rad; ++pass) {
    if (pass > 0 && !any_found()) break;  // repeats alone would forget that the lines do not meet
    const double estimate = sigma_theta_sq_from(problem, sights, result.landmarks);
    if (!(estimate > 0.0)) break;
    sigma_theta_sq = estimate;
    result.sigma_theta_estimated = true;
    solve_all();
  }
  result.sigma_theta_rad = std::sqrt(sigma_theta_sq);
  for (const Sight& s : sights) result.cell_weights.push_back(weight_of(s, options.weights, sigma_theta_sq));

  int found = 0;
  for (std::size_t l = 0; l < result.landmarks.size(); ++l) {
    if (result.landmarks[l].outcome == Outcome::converged) {
      ++found;
      continue;
    }
    if (!result.reason.empty()) result.reason += "; ";
    result.reason += "landmark " + std::to_string(l) + ": " + result.landmarks[l].reason;
  }
  const bool all = found == static_cast<int>(result.landmarks.size());
  result.outcome = found == 0 ? (sights.empty() ? Outcome::too_few_data : Outcome::unobservable)
                   : all      ? Outcome::converged
                              : Outcome::unobservable;
  return result;
}

std::vector<std::optional<Eigen::Vector2d>> landmarks_from_positions(const JointProblem& problem) {
  const Cells& cells = problem.cells;
  std::vector<Eigen::Vector3d> sums(problem.landmark_count(), Eigen::Vector3d::Zero());
  for (std::size_t c = 0; c < cells.size(); ++c) {
    const Pose2& stop = problem.stops[cells.stop[c]].commanded;
    const double phi = stop.heading_rad + cells.bearing_mean[c], r = cells.range_mean[c] + cells.radius_m[c];
    sums[cells.landmark[c]] +=
        cells.count[c] * Eigen::Vector3d(stop.x_m + r * std::cos(phi), stop.y_m + r * std::sin(phi), 1.0);
  }
  std::vector<std::optional<Eigen::Vector2d>> positions(sums.size());
  for (std::size_t l = 0; l < sums.size(); ++l) {
    if (sums[l].z() > 0.0) positions[l] = sums[l].head<2>() / sums[l].z();
  }
  return positions;
}

}  // namespace rangecal
