// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/stop_residual.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "rangecal/core/angles.hpp"

namespace rangecal {
namespace {

constexpr int max_coefficients = 9;

}  // namespace

/// f and s at one set of blocks.
struct StopResidual::Curve {
  std::array<double, max_coefficients> alpha, tau;
  int coefficients, taus, power_of_f;
  NoiseLaw law;
  double inverse_sigma_theta;

  std::array<double, max_coefficients> power;  ///< d^i
  double f, f_slope, log_spread, inverse_s;
  double by_f, by_d, inverse_f;                ///< dlambda/df, and dlambda/dd with f held

  /// False outside of the domain.
  bool at(double d) {
    if (!(d > 0.0)) return false;
    f = f_slope = 0.0;
    power[0] = 1.0;
    for (int i = 1; i < std::max(coefficients, taus); ++i) power[i] = d * power[i - 1];
    for (int i = coefficients; i-- > 0;) {
      f_slope = f_slope * d + f;
      f = f * d + alpha[i];
    }
    by_f = by_d = 0.0;
    if (law == NoiseLaw::polynomial) {
      double s = 0.0, slope = 0.0;
      for (int i = taus; i-- > 0;) {
        slope = slope * d + s;
        s = s * d + tau[i];
      }
      if (!(s > 0.0)) return false;
      inverse_s = 1.0 / s;
      log_spread = std::log(s);
      by_d = slope * inverse_s;
      return true;
    }
    double base = 1.0;
    if (power_of_f > 0) {
      if (!(f > 0.0)) return false;
      inverse_f = 1.0 / f;
      by_f = power_of_f * inverse_f;
      for (int i = 0; i < power_of_f; ++i) base *= f;
    } else if (law == NoiseLaw::d_squared) {
      base = d * d;
      by_d = 2.0 / d;
    }
    log_spread = tau[0] + std::log(base);
    inverse_s = std::exp(-tau[0]) / base;
    return std::isfinite(inverse_s) && std::isfinite(log_spread);
  }
  double by_tau(int j) const { return law == NoiseLaw::polynomial ? power[j] * inverse_s : 1.0; }
};

StopResidual::StopResidual(const JointProblem& problem, const JointState& reference, const Eigen::MatrixXd& basis,
                           std::vector<int> stops)
    : problem_(&problem),
      alpha_(reference.alpha),
      basis_(basis),
      law_(reference.noise.law),
      tau_count_(static_cast<int>(reference.noise.parameters.size())),
      power_of_f_(reference.noise.power_of_f()),
      stops_(std::move(stops)) {
  const Cells& c = problem.cells;
  int priors = 0;
  for (int k : stops_) {
    const StopPrior& prior = problem.stops[k];
    reference_stops_.push_back(reference.stops[k]);
    double sigma = 0.0;
    if (prior.opens_place) {
      sigma = sigma_xy_of(problem, reference, k);
      free_position_ = sigma > 0.0;
      coordinates_ = free_position_ ? 2 : 0;
    }
    if (prior.chained) sigma = 0.0;
    sigma_xy_.push_back(sigma);
    if (sigma > 0.0) priors += 2;
    heading_.push_back(prior.sigma_heading_rad > 0.0 ? coordinates_++ : -1);
    if (heading_.back() >= 0 && !prior.chained) ++priors;
    for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
      const auto found = std::find(landmarks_.begin(), landmarks_.end(), c.landmark[i]);
      slot_of_cell_.push_back(static_cast<int>(found - landmarks_.begin()));
      if (found == landmarks_.end()) landmarks_.push_back(c.landmark[i]);
      repeats_ = repeats_ || c.range_mean_square[i] > 0.0;
      const Eigen::Vector2d v = reference.landmarks[c.landmark[i]] - Eigen::Vector2d(reference.stops[k].x_m, reference.stops[k].y_m);
      const double d = v.norm() - c.radius_m[i];
      double f = 0.0;
      for (Eigen::Index a = alpha_.size(); a-- > 0;) f = f * d + alpha_[a];
      reference_log_spread_.push_back(std::log(reference.noise.spread(d, f)));
    }
  }
  residuals_ = static_cast<int>(slot_of_cell_.size()) * (repeats_ ? 4 : 3) + priors + 1;
}

std::vector<int> StopResidual::block_sizes() const {
  std::vector<int> sizes = {static_cast<int>(alpha_.size()), tau_count_ + 1};
  if (coordinates_ > 0) sizes.push_back(coordinates_);
  sizes.resize(sizes.size() + landmarks_.size(), 2);
  return sizes;
}

StopResidual::Curve StopResidual::unpack(const double* const* blocks) const {
  Curve curve;
  curve.coefficients = static_cast<int>(alpha_.size());
  curve.taus = tau_count_;
  curve.power_of_f = power_of_f_;
  curve.law = law_;
  for (int i = 0; i < curve.coefficients; ++i) {
    curve.alpha[i] = alpha_[i];
    for (int j = 0; j < curve.coefficients; ++j) curve.alpha[i] += basis_(i, j) * blocks[0][j];
  }
  std::copy(blocks[1], blocks[1] + tau_count_, curve.tau.begin());
  curve.inverse_sigma_theta = std::exp(-blocks[1][tau_count_]);
  return curve;
}

bool StopResidual::log_spreads(const double* const* blocks, double* log_spread) const {
  Curve curve = unpack(blocks);
  const double* own = coordinates_ > 0 ? blocks[2] : nullptr;
  const double* const* landmark = blocks + (coordinates_ > 0 ? 3 : 2);
  const Cells& c = problem_->cells;
  int cell = 0;
  for (std::size_t slot = 0; slot < stops_.size(); ++slot) {
    const double x = reference_stops_[slot].x_m + (free_position_ ? own[0] : 0.0);
    const double y = reference_stops_[slot].y_m + (free_position_ ? own[1] : 0.0);
    for (int i = c.stop_begin[stops_[slot]]; i < c.stop_begin[stops_[slot] + 1]; ++i, ++cell) {
      const double* m = landmark[slot_of_cell_[cell]];
      if (!curve.at(std::hypot(m[0] - x, m[1] - y) - c.radius_m[i])) return false;
      log_spread[cell] = curve.log_spread;
    }
  }
  return true;
}

bool StopResidual::set_reference(const double* const* blocks) {
  std::vector<double> spread(reference_log_spread_.size());
  if (!log_spreads(blocks, spread.data())) return false;
  reference_log_spread_ = spread;
  return true;
}

bool StopResidual::evaluate(const double* const* blocks, const double* log_floor, double* residuals,
                            double** jacobians) const {
  Curve curve = unpack(blocks);
  const Cells& c = problem_->cells;
  const int na = curve.coefficients, nt = tau_count_, first_landmark = coordinates_ > 0 ? 3 : 2;
  const double* own = coordinates_ > 0 ? blocks[2] : nullptr;
  const int per_cell = repeats_ ? 4 : 3;
  const auto jacobian = [&](int block) { return jacobians ? jacobians[block] : nullptr; };
  double* by_u = jacobian(0);
  double* by_sigma = jacobian(1);
  double* by_own = coordinates_ > 0 ? jacobian(2) : nullptr;
  if (jacobians) {
    if (by_u) std::fill_n(by_u, residuals_ * na, 0.0);
    if (by_sigma) std::fill_n(by_sigma, residuals_ * (nt + 1), 0.0);
    if (by_own) std::fill_n(by_own, residuals_ * coordinates_, 0.0);
    for (std::size_t l = 0; l < landmarks_.size(); ++l)
      if (double* j = jacobian(first_landmark + static_cast<int>(l))) std::fill_n(j, residuals_ * 2, 0.0);
  }

  int cell = 0, row = 0;
  double level = 0.0;
  for (std::size_t slot = 0; slot < stops_.size(); ++slot) {
    const int k = stops_[slot], heading = heading_[slot];
    const double x = reference_stops_[slot].x_m + (free_position_ ? own[0] : 0.0);
    const double y = reference_stops_[slot].y_m + (free_position_ ? own[1] : 0.0);
    const double h = reference_stops_[slot].heading_rad + (heading >= 0 ? own[heading] : 0.0);
    for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i, ++cell, row += per_cell) {
      const double* m = blocks[first_landmark + slot_of_cell_[cell]];
      const double vx = m[0] - x, vy = m[1] - y, D = std::sqrt(vx * vx + vy * vy);
      const double d = D - c.radius_m[i], bend = c.bend.empty() ? 0.0 : c.bend[i];
      if (!curve.at(d)) return false;
      const double R = c.count[i], root_W = std::sqrt(c.range_weight[i]);
      const double floor = log_floor ? log_floor[cell] : curve.log_spread - 0.5;
      const double height = curve.log_spread - floor;
      if (!(height > 0.0)) return false;
      level += R * (floor - reference_log_spread_[cell] + margin);
      const double turn = wrap_angle(c.bearing_mean[i] - std::atan2(vy, vx) + h);
      double* r = residuals + row;
      r[0] = root_W * (c.range_mean[i] - curve.f - c.bent(i, d)) * curve.inverse_s;
      r[1] = std::sqrt(2.0 * R * height);
      r[2] = std::sqrt(c.bearing_weight[i]) * turn * curve.inverse_sigma_theta;
      if (repeats_) r[3] = root_W * std::sqrt(c.range_mean_square[i]) * curve.inverse_s;
      if (!jacobians) continue;

      // d r = by_mean df + by_log dlambda, row by row.
      const double by_mean = -root_W * curve.inverse_s;
      const double by_log[4] = {-r[0], R / r[1], 0.0, repeats_ ? -r[3] : 0.0};
      const double lambda_slope = curve.by_f * curve.f_slope + curve.by_d;
      const double nx = vx / D, ny = vy / D, across = std::sqrt(c.bearing_weight[i]) * curve.inverse_sigma_theta / D;
      std::array<double, max_coefficients> f_by_u{};
      for (int j = 0; j < na; ++j)
        for (int a = 0; a < na; ++a) f_by_u[j] += curve.power[a] * basis_(a, j);
      for (int e = 0; e < per_cell; ++e) {
        const double in_f = (e == 0 ? by_mean : 0.0) + by_log[e] * curve.by_f;
        if (by_u && e != 2)
          for (int j = 0; j < na; ++j) by_u[(row + e) * na + j] = in_f * f_by_u[j];
        if (by_sigma) {
          for (int j = 0; j < nt; ++j) by_sigma[(row + e) * (nt + 1) + j] = by_log[e] * curve.by_tau(j);
          if (e == 2) by_sigma[(row + e) * (nt + 1) + nt] = -r[2];
        }
        const double in_d = (e == 0 ? by_mean * (curve.f_slope + bend) : 0.0) + by_log[e] * lambda_slope;
        const double sx = e == 2 ? across * ny : in_d * nx, sy = e == 2 ? -across * nx : in_d * ny;  // in the landmark
        if (double* j = jacobian(first_landmark + slot_of_cell_[cell])) {
          j[(row + e) * 2] = sx;
          j[(row + e) * 2 + 1] = sy;
        }
        if (!by_own) continue;
        if (free_position_) {
          by_own[(row + e) * coordinates_] = -sx;
          by_own[(row + e) * coordinates_ + 1] = -sy;
        }
        if (heading >= 0 && e == 2)
          by_own[(row + e) * coordinates_ + heading] = std::sqrt(c.bearing_weight[i]) * curve.inverse_sigma_theta;
      }
    }
  }
  for (std::size_t slot = 0; slot < stops_.size(); ++slot) {
    const StopPrior& prior = problem_->stops[stops_[slot]];
    if (const double sigma = sigma_xy_[slot]; sigma > 0.0) {
      residuals[row] = (reference_stops_[slot].x_m + own[0] - prior.commanded.x_m) / sigma;
      residuals[row + 1] = (reference_stops_[slot].y_m + own[1] - prior.commanded.y_m) / sigma;
      if (by_own) {
        by_own[row * coordinates_] = 1.0 / sigma;
        by_own[(row + 1) * coordinates_ + 1] = 1.0 / sigma;
      }
      row += 2;
    }
    if (const int heading = heading_[slot]; heading >= 0 && !prior.chained) {
      residuals[row] = wrap_angle(reference_stops_[slot].heading_rad + own[heading] - prior.commanded.heading_rad) /
                       prior.sigma_heading_rad;
      if (by_own) by_own[row * coordinates_ + heading] = 1.0 / prior.sigma_heading_rad;
      ++row;
    }
  }
  if (!(level >= 0.0)) return false;
  residuals[row] = std::sqrt(2.0 * level);
  return true;
}

bool BearingSpreadResidual::evaluate(const double* sigmas, const double* log_floor, double* residuals,
                                     double* jacobian) const {
  const double log_sigma = sigmas[index], floor = log_floor ? *log_floor : log_sigma - 0.5;
  const double height = log_sigma - floor, level = readings * (floor - log_reference + StopResidual::margin);
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

}  // namespace rangecal
