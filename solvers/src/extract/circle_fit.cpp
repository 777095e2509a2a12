// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/circle_fit.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <vector>

#include "extract/arc_slope.hpp"

namespace rangecal {
namespace {

constexpr int kIterations = 30, kSelections = 6;

struct State {
  double s = 0.0, b = 0.0, radius = 0.0;
  double axis() const { return s + radius; }
};

/// Beams that pass the axis at no more than `cut` of the radius.
std::vector<Beam> inner_beams(std::span<const Beam> beams, const State& at, double cut) {
  std::vector<Beam> inner;
  for (const Beam& beam : beams)
    if (std::abs(at.axis() * std::sin(beam.bearing_rad - at.b)) <= cut * at.radius) inner.push_back(beam);
  return inner;
}

/// Normal equations of the range residuals and of the outline at a state.
struct Normal {
  Eigen::Matrix3d information = Eigen::Matrix3d::Zero();
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  double chi_squared = 0.0;
};

Normal linearise(std::span<const Beam> beams, const Outline& outline, double sigma, const State& at) {
  Normal normal;
  const double weight = 1.0 / (sigma * sigma);
  for (const Beam& beam : beams) {
    const extract::ArcPoint point = extract::arc_point(at.s, at.b, at.radius, beam.bearing_rad);
    const double residual = beam.range_m - point.range_m;
    normal.information += weight * point.slope * point.slope.transpose();
    normal.gradient += weight * residual * point.slope;
    normal.chi_squared += weight * residual * residual;
  }
  const double off = (outline.centre_rad - at.b) / outline.centre_sd_rad;
  normal.information(1, 1) += 1.0 / (outline.centre_sd_rad * outline.centre_sd_rad);
  normal.gradient(1) += off / outline.centre_sd_rad;
  normal.chi_squared += off * off;
  return normal;
}

/// Gauss-Newton with halved steps over the first `unknowns` of (s, b, R). False where it does not settle.
bool minimise(std::span<const Beam> beams, const Outline& outline, double sigma, int unknowns, State& at) {
  Normal normal = linearise(beams, outline, sigma, at);
  for (int iteration = 0; iteration < kIterations; ++iteration) {
    const Eigen::MatrixXd information = normal.information.topLeftCorner(unknowns, unknowns);
    const Eigen::LDLT<Eigen::MatrixXd> solver(information);
    if (solver.info() != Eigen::Success || !(solver.vectorD().minCoeff() > 0.0)) return false;
    const Eigen::VectorXd step = solver.solve(normal.gradient.head(unknowns));
    if (!step.allFinite()) return false;
    if (step.dot(information * step) < 1e-10) return true;  // the step in standard deviations
    bool better = false;
    for (double share = 1.0; share > 1e-3 && !better; share *= 0.5) {
      State next = at;
      next.s += share * step(0), next.b += share * step(1);
      if (unknowns == 3) next.radius += share * step(2);
      if (!(next.s > 0.0) || !(next.radius > 0.0)) continue;
      const Normal there = linearise(beams, outline, sigma, next);
      better = there.chi_squared <= normal.chi_squared;
      if (better) at = next, normal = there;
    }
    if (!better) return true;  // nothing nearby is better
  }
  return false;
}

}  // namespace

Outline outline_of(double miss_left_rad, double hit_left_rad, double hit_right_rad, double miss_right_rad) {
  const double left = 0.5 * (miss_left_rad + hit_left_rad), right = 0.5 * (hit_right_rad + miss_right_rad);
  const double gap_left = hit_left_rad - miss_left_rad, gap_right = miss_right_rad - hit_right_rad;
  return {0.5 * (left + right), std::sqrt((gap_left * gap_left + gap_right * gap_right) / 48.0),
          0.5 * (right - left)};
}

std::optional<double> range_on_circle(double axis_distance_m, double radius_m, double psi_rad) {
  const double aside = axis_distance_m * std::sin(psi_rad);
  if (std::abs(aside) >= radius_m || std::cos(psi_rad) <= 0.0) return std::nullopt;
  return axis_distance_m * std::cos(psi_rad) - std::sqrt(radius_m * radius_m - aside * aside);
}

std::optional<CircleFit> fit_circle(std::span<const Beam> beams, const Outline& outline,
                                    const CircleFitOptions& options) {
  if (beams.empty()) return std::nullopt;
  const int unknowns = options.radius_m ? 2 : 3;
  const double nearest = std::min_element(beams.begin(), beams.end(), [](const Beam& a, const Beam& b) {
                           return a.range_m < b.range_m;
                         })->range_m;
  State at{nearest, outline.centre_rad, options.radius_m.value_or(0.0)};
  if (!options.radius_m) {  // half-width = asin(R / (s + R))
    const double sine = std::min(0.9, std::sin(outline.half_width_rad));
    at.radius = std::clamp(nearest * sine / (1.0 - sine), options.radius_min_m, options.radius_max_m);
  }
  std::vector<Beam> inner;
  for (int selection = 0; selection < kSelections; ++selection) {
    std::vector<Beam> chosen = inner_beams(beams, at, options.edge_cut);
    if (static_cast<int>(chosen.size()) < unknowns) return std::nullopt;
    const bool same = chosen.size() == inner.size() && !inner.empty() &&
                      chosen.front().bearing_rad == inner.front().bearing_rad;
    if (same) break;
    inner = std::move(chosen);
    if (!minimise(inner, outline, options.sigma_m, unknowns, at)) return std::nullopt;
    if (at.radius > 2.0 * options.radius_max_m) return std::nullopt;
  }
  if (!options.radius_m && (at.radius < options.radius_min_m || at.radius > options.radius_max_m))
    return std::nullopt;

  const Normal normal = linearise(inner, outline, options.sigma_m, at);
  const Eigen::MatrixXd covariance = normal.information.topLeftCorner(unknowns, unknowns).inverse();
  if (!covariance.allFinite() || !(covariance.diagonal().minCoeff() > 0.0)) return std::nullopt;
  CircleFit fit;
  fit.range_m = at.s, fit.bearing_rad = at.b, fit.radius_m = at.radius;
  fit.range_sd_m = std::sqrt(covariance(0, 0)), fit.bearing_sd_rad = std::sqrt(covariance(1, 1));
  if (unknowns == 3) fit.radius_sd_m = std::sqrt(covariance(2, 2));
  fit.chi_squared = normal.chi_squared;
  fit.used = static_cast<int>(inner.size());
  fit.edge_beams = static_cast<int>(beams.size()) - fit.used;
  fit.degrees_of_freedom = fit.used + 1 - unknowns;
  fit.smallest_m = inner.front().range_m;
  for (const Beam& beam : inner) {
    fit.mean_m += beam.range_m / fit.used;
    fit.smallest_m = std::min(fit.smallest_m, beam.range_m);
  }
  fit.mean_sd_m = options.sigma_m / std::sqrt(static_cast<double>(fit.used));
  return fit;
}

FlatFit fit_flat(std::span<const Beam> beams, double sigma_m) {
  Eigen::Matrix2d information = Eigen::Matrix2d::Zero();
  Eigen::Vector2d right = Eigen::Vector2d::Zero();
  for (const Beam& beam : beams) {  // u = 1/r has standard deviation sigma / r^2
    const Eigen::Vector2d direction(std::cos(beam.bearing_rad), std::sin(beam.bearing_rad));
    const double weight = std::pow(beam.range_m, 4) / (sigma_m * sigma_m);
    information += weight * direction * direction.transpose();
    right += weight / beam.range_m * direction;
  }
  const Eigen::Vector2d line = information.ldlt().solve(right);
  FlatFit fit;
  for (const Beam& beam : beams) {
    const double u = line(0) * std::cos(beam.bearing_rad) + line(1) * std::sin(beam.bearing_rad);
    const double residual = u > 0.0 ? beam.range_m - 1.0 / u : beam.range_m;
    fit.chi_squared += residual * residual / (sigma_m * sigma_m);
  }
  fit.degrees_of_freedom = static_cast<int>(beams.size()) - 2;
  return fit;
}

}  // namespace rangecal
