// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/phase_interval.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>
#include <numbers>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::diagnosis {

std::optional<Limits> phase_interval(const Eigen::Vector2d& x, const Eigen::Matrix2d& C, double nu) {
  const Eigen::LLT<Eigen::Matrix2d> factor(C);
  if (factor.info() != Eigen::Success || !x.allFinite()) return std::nullopt;
  const Eigen::Vector2d w = factor.matrixL().solve(x);
  const bool known = std::isinf(nu);
  const double t = known ? z95 : student_t_quantile(0.975, nu),
               least = known ? radius95 : std::sqrt(nu * std::expm1(-2.0 / nu * std::log(0.05)));
  if (!(w.norm() > least)) return std::nullopt;
  const double middle = std::atan2(x.y(), x.x()), half = std::asin(t / w.norm());
  const auto tangent = [&](double turn) {
    const Eigen::Vector2d along = factor.matrixL() * (Eigen::Rotation2Dd(turn) * w);
    return middle + std::remainder(std::atan2(along.y(), along.x()) - middle, 2.0 * std::numbers::pi);
  };
  return Limits{tangent(-half), tangent(half)};
}

}  // namespace rangecal::diagnosis
