// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/cell_residual.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/problems/landmarks/range_term.hpp"

namespace rangecal {
namespace {

constexpr int max_coefficients = RangeTerm<3>::max_coefficients;

}  // namespace

CurveBlock::CurveBlock(const JointState& reference, Eigen::MatrixXd given)
    : origin(reference.alpha),
      basis(std::move(given)),
      law(reference.noise.law),
      tau_count(static_cast<int>(reference.noise.parameters.size())) {}

Pose2 StopBlock::pose(const double* own) const {
  Pose2 pose = reference;
  if (position) {
    pose.x_m += own[0];
    pose.y_m += own[1];
  }
  if (heading >= 0) pose.heading_rad += own[heading];
  return pose;
}

/// f and s at one point of the curve's block and one distance.
struct CellResidual::Curve {
  std::array<double, max_coefficients> power;  ///< d^i
  double f = 0.0, f_slope = 0.0, log_spread, inverse_s;
  double by_f = 0.0, by_d = 0.0;  ///< dlambda/df, and dlambda/dd with f held

  /// False outside of the domain.
  bool at(const CurveBlock& block, const double* u, double d) {
    if (!(d > 0.0)) return false;
    const int n = block.alpha_count();
    const double* tau = u + n;
    power[0] = 1.0;
    for (int i = 1; i < std::max(n, block.tau_count); ++i) power[i] = d * power[i - 1];
    for (int i = n; i-- > 0;) {
      double alpha = block.origin[i];
      for (int j = 0; j < n; ++j) alpha += block.basis(i, j) * u[j];
      f_slope = f_slope * d + f;
      f = f * d + alpha;
    }
    if (!has_sigma(block.law)) {
      double s = 0.0, slope = 0.0;
      for (int i = block.tau_count; i-- > 0;) {
        slope = slope * d + s;
        s = s * d + tau[i];
      }
      if (!(s > 0.0)) return false;
      inverse_s = 1.0 / s;
      log_spread = std::log(s);
      by_d = slope * inverse_s;
      return true;
    }
    const NoiseForm form = form_of(block.law);
    double base = 1.0;
    if (form.power_of_f > 0) {
      if (!(f > 0.0)) return false;
      by_f = form.power_of_f / f;
      for (int i = 0; i < form.power_of_f; ++i) base *= f;
    }
    if (form.power_of_d > 0) {
      by_d = form.power_of_d / d;
      for (int i = 0; i < form.power_of_d; ++i) base *= d;
    }
    log_spread = tau[0] + std::log(base);
    inverse_s = std::exp(-tau[0]) / base;
    return std::isfinite(inverse_s) && std::isfinite(log_spread);
  }
};

CellResidual::CellResidual(const JointProblem& problem, const CurveBlock& curve, const JointState& reference,
                           StopBlock stop, int cell)
    : problem_(&problem),
      curve_(&curve),
      stop_(stop),
      cell_(cell),
      repeats_(problem.cells.range_mean_square[cell] > 0.0) {
  const Eigen::Vector2d v =
      reference.landmarks[landmark()] - Eigen::Vector2d(stop.reference.x_m, stop.reference.y_m);
  const double d = v.norm() - problem.cells.radius_m[cell];
  double f = 0.0;
  for (Eigen::Index a = reference.alpha.size(); a-- > 0;) f = f * d + reference.alpha[a];
  reference_log_spread_ = std::log(reference.noise.spread(d, f));
}

std::vector<int> CellResidual::block_sizes() const {
  std::vector<int> sizes = {curve_->size()};
  if (stop_.size > 0) sizes.push_back(stop_.size);
  sizes.push_back(2);
  return sizes;
}

bool CellResidual::log_spread(const double* const* blocks, double& log_spread) const {
  const Pose2 at = stop_.pose(blocks[1]);
  const double* m = blocks[stop_.size > 0 ? 2 : 1];
  Curve curve;
  if (!curve.at(*curve_, blocks[0],
                std::hypot(m[0] - at.x_m, m[1] - at.y_m) - problem_->cells.radius_m[cell_]))
    return false;
  log_spread = curve.log_spread;
  return true;
}

bool CellResidual::evaluate(const double* const* blocks, const double* log_floor, double* r,
                            double** jacobians) const {
  const Cells& c = problem_->cells;
  const int na = curve_->alpha_count(), nt = curve_->tau_count, last = stop_.size > 0 ? 2 : 1,
            rows = residual_count();
  const Pose2 at = stop_.pose(blocks[1]);
  const double vx = blocks[last][0] - at.x_m, vy = blocks[last][1] - at.y_m, D = std::sqrt(vx * vx + vy * vy);
  const double d = D - c.radius_m[cell_];
  Curve curve;
  if (!curve.at(*curve_, blocks[0], d)) return false;
  const double R = c.count[cell_], root_W = std::sqrt(c.range_weight[cell_]);
  const double floor = log_floor ? *log_floor : curve.log_spread - 0.5, height = curve.log_spread - floor;
  const double level = R * (floor - reference_log_spread_ + margin);
  if (!(height > 0.0) || !(level >= 0.0)) return false;
  const double bearing_scale = std::sqrt(c.bearing_weight[cell_]) * std::exp(-blocks[0][na + nt]);
  r[0] = root_W * (c.range_mean[cell_] - curve.f - c.effect_change(cell_, d)) * curve.inverse_s;
  r[1] = std::sqrt(2.0 * R * height);
  r[2] = bearing_scale * wrap_angle(c.bearing_mean[cell_] - std::atan2(vy, vx) + at.heading_rad);
  r[3] = std::sqrt(2.0 * level);
  if (repeats_) r[4] = root_W * std::sqrt(c.range_mean_square[cell_]) * curve.inverse_s;
  if (!jacobians) return true;

  // d r = by_mean df + by_log dlambda, row by row; the bearing's row knows no f, and the level
  // moves with the floor only.
  const double by_mean = -root_W * curve.inverse_s,
               effect_slope = c.effect_slope.empty() ? 0.0 : c.effect_slope[cell_];
  const double by_log[5] = {-r[0], R / r[1], 0.0, 0.0, repeats_ ? -r[4] : 0.0};
  const double lambda_slope = curve.by_f * curve.f_slope + curve.by_d;
  const double nx = vx / D, ny = vy / D, across = bearing_scale / D;
  std::array<double, max_coefficients> f_by_u;
  for (int j = 0; j < na; ++j) {
    f_by_u[j] = 0.0;
    for (int a = 0; a < na; ++a) f_by_u[j] += curve.power[a] * curve_->basis(a, j);
  }
  double* by_own = stop_.size > 0 ? jacobians[1] : nullptr;
  if (by_own) std::fill_n(by_own, rows * stop_.size, 0.0);
  for (int e = 0; e < rows; ++e) {
    const double in_f = (e == 0 ? by_mean : 0.0) + by_log[e] * curve.by_f;
    if (double* by_curve = jacobians[0] ? jacobians[0] + e * curve_->size() : nullptr) {
      for (int j = 0; j < na; ++j) by_curve[j] = in_f * f_by_u[j];
      for (int j = 0; j < nt; ++j)
        by_curve[na + j] = by_log[e] * (!has_sigma(curve_->law) ? curve.power[j] * curve.inverse_s : 1.0);
      by_curve[na + nt] = e == 2 ? -r[2] : 0.0;
    }
    const double in_d = (e == 0 ? by_mean * (curve.f_slope + effect_slope) : 0.0) + by_log[e] * lambda_slope;
    const double sx = e == 2 ? across * ny : in_d * nx,
                 sy = e == 2 ? -across * nx : in_d * ny;  // in the landmark
    if (double* by_landmark = jacobians[last]) {
      by_landmark[2 * e] = sx;
      by_landmark[2 * e + 1] = sy;
    }
    if (!by_own) continue;
    if (stop_.position) {
      by_own[e * stop_.size] = -sx;
      by_own[e * stop_.size + 1] = -sy;
    }
    if (stop_.heading >= 0 && e == 2) by_own[e * stop_.size + stop_.heading] = bearing_scale;
  }
  return true;
}

bool BearingSpreadResidual::evaluate(const double* sigmas, const double* log_floor, double* residuals,
                                     double* jacobian) const {
  const double log_sigma = sigmas[index], floor = log_floor ? *log_floor : log_sigma - 0.5;
  const double height = log_sigma - floor, level = readings * (floor - log_reference + CellResidual::margin);
  if (!(height > 0.0) || !(level >= 0.0)) return false;
  residuals[0] = std::sqrt(square_sum) * std::exp(-log_sigma);
  residuals[1] = std::sqrt(2.0 * readings * height);
  residuals[2] = std::sqrt(2.0 * level);
  if (!jacobian) return std::isfinite(residuals[0]);
  std::fill_n(jacobian, 3 * block_size, 0.0);
  jacobian[index] = -residuals[0];
  jacobian[block_size + index] = readings / residuals[1];
  return std::isfinite(residuals[0]);
}

StopPriorResidual::StopPriorResidual(const StopPrior& prior, double sigma_xy_m, const StopBlock& given)
    : stop(given), commanded(prior.commanded) {
  if (prior.chained) return;
  const StopInformation information(prior, sigma_xy_m);
  position = information.position;
  heading = information.heading;
  root = information.root();
}

void StopPriorResidual::evaluate(const double* own, double* residuals, double* jacobian) const {
  const Pose2 at = stop.pose(own);
  const Eigen::Vector3d e(at.x_m - commanded.x_m, at.y_m - commanded.y_m,
                          wrap_angle(at.heading_rad - commanded.heading_rad));
  const Eigen::Vector3d white = root * e;
  if (jacobian) std::fill_n(jacobian, residual_count() * stop.size, 0.0);
  int row = 0;
  for (int i = position ? 0 : 2; i < (heading ? 3 : 2); ++i, ++row) {
    residuals[row] = white[i];
    if (!jacobian) continue;
    double* const by_own = jacobian + row * stop.size;
    if (position)
      for (int e_xy = i; e_xy < 2; ++e_xy) by_own[e_xy] = root(i, e_xy);
    if (heading) by_own[stop.heading] = root(i, 2);
  }
}

}  // namespace rangecal
