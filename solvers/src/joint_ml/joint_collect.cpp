// SPDX-License-Identifier: BSD-3-Clause
// What concerns the globals alone: their blocks from the parts' sums, taped distances, and spreads in closed form.

#include <Eigen/Core>
#include <array>
#include <cmath>

#include "in_parallel.hpp"
#include "joint_ml/joint_accumulator.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {

void JointSystem::collect(const std::vector<Accumulator>& parts) {
  const Accumulator& s = parts[0];
  const int na = layout_.alpha_count, m = s.m, landmark0 = layout_.landmark_begin;
  const int landmarks = problem_.landmark_count(), eta = layout_.sigma_theta;
  const auto global = [&](int curve) { return curve < na ? curve : layout_.tau_begin + curve - na; };
  gradient_.setZero();
  hessian_.setZero();
  for (int a = 0; a < m; ++a) {
    gradient_[global(a)] = s.curve_gradient[a];
    for (int e = a; e < m; ++e) hessian_(global(a), global(e)) = s.curve_hessian[a * m + e];
  }
  gradient_[eta] = s.bearing_gradient;
  hessian_(eta, eta) = s.bearing_hessian;
  if (layout_.sigma_s >= 0) {
    gradient_[layout_.sigma_s] = s.sigma_s_gradient;
    hessian_(layout_.sigma_s, layout_.sigma_s) = s.sigma_s_hessian;
  }
  for (int l = 0; l < landmarks; ++l) {
    const double* of = s.landmark.data() + static_cast<std::size_t>(l) * s.stride;
    const int x = landmark0 + 2 * l;
    gradient_[x] = of[0];
    gradient_[x + 1] = of[1];
    hessian_(x, x) = of[2];
    hessian_(x, x + 1) = of[3];
    hessian_(x + 1, x + 1) = of[4];
    for (int a = 0; a < m; ++a)
      for (int e = 0; e < 2; ++e) {
        const int other = global(a);
        hessian_(std::min(other, x + e), std::max(other, x + e)) = of[5 + 2 * a + e];
      }
    hessian_(x, eta) = of[5 + 2 * m];
    hessian_(x + 1, eta) = of[6 + 2 * m];
  }
}

void JointSystem::profile_spreads(JointState& state) const {
  const Cells& c = problem_.cells;
  const std::size_t stops = problem_.stops.size();
  const int parts = part_count(stops), na = static_cast<int>(state.alpha.size());
  const int power = state.noise.power_of_f();
  const bool plain = is_power_of_f(state.noise.law);
  std::vector<std::array<double, 2>> sums(parts, {0.0, 0.0});
  const auto run = [&](int part) {
    double range = 0.0, bearing = 0.0;
    for (std::size_t k = stops * part / parts; k < stops * (part + 1) / parts; ++k) {
      const Pose2& pose = state.stops[k];
      const double ch = pose.heading_rad == 0.0 ? 1.0 : std::cos(pose.heading_rad);
      const double sh = pose.heading_rad == 0.0 ? 0.0 : std::sin(pose.heading_rad);
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i) {
        const Eigen::Vector2d& axis = state.landmarks[c.landmark[i]];
        const double vx = axis.x() - pose.x_m, vy = axis.y() - pose.y_m;
        const double d = std::sqrt(vx * vx + vy * vy) - c.radius_m[i];
        double f = state.alpha[na - 1];
        for (int a = na - 1; a-- > 0;) f = f * d + state.alpha[a];
        double s = state.noise.parameters[0];
        if (plain)
          for (int e = 0; e < power; ++e) s *= f;
        else
          s = state.noise.spread(d, f);
        const double cb = bearing_direction_[2 * i], sb = bearing_direction_[2 * i + 1];
        const double turn = bearing_error(cb * ch - sb * sh, sb * ch + cb * sh, vx, vy),
                     e = c.range_mean[i] - f - c.effect_change(i, d);
        range += c.range_weight[i] * (e * e + c.range_mean_square[i]) / (s * s);
        bearing += c.bearing_weight[i] * (turn * turn + c.bearing_mean_square[i]);
      }
    }
    sums[part] = {range, bearing};
  };
  in_parallel(parts, run);
  double range = 0.0, bearing = 0.0;
  for (const auto& sum : sums) {
    range += sum[0];
    bearing += sum[1];
  }
  const double scale = std::sqrt(range / problem_.readings), sigma = std::sqrt(bearing / problem_.readings);
  if (std::isfinite(scale) && scale > 0.0) state.noise.parameters *= scale;
  if (std::isfinite(sigma) && sigma > 0.0) state.sigma_theta_rad = sigma;
}

double JointSystem::assemble_taped(const JointState& state, HessianKind kind) {
  double nll = 0.0;
  for (const KnownDistance& taped : problem_.known_distances) {
    const Eigen::Vector2d v = state.landmarks[taped.to] - state.landmarks[taped.from];
    const double length = v.norm(), error = length - taped.distance_m;
    const double information = 1.0 / (taped.sigma_m * taped.sigma_m);
    const Eigen::Vector2d n = v / length;
    nll += 0.5 * error * error * information + std::log(taped.sigma_m) + half_log_two_pi;
    Eigen::Matrix2d h = information * n * n.transpose();
    if (kind == HessianKind::exact)
      h += (information * error / length) * (Eigen::Matrix2d::Identity() - n * n.transpose());
    const int a = layout_.landmark_begin + 2 * taped.from, b = layout_.landmark_begin + 2 * taped.to;
    gradient_.segment<2>(a) -= information * error * n;
    gradient_.segment<2>(b) += information * error * n;
    hessian_.block<2, 2>(a, a) += h;
    hessian_.block<2, 2>(b, b) += h;
    hessian_.block<2, 2>(std::min(a, b), std::max(a, b)) -= h;
  }
  return nll;
}

}  // namespace rangecal
