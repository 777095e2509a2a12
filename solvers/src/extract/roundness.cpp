// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/roundness.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace rangecal {

void Roundness::add(std::span<const Beam> beams, const CircleFit& fit, double sigma_m, double edge_cut) {
  std::vector<Eigen::Vector2d> points;
  for (const Beam& beam : beams) {
    const double psi = beam.bearing_rad - fit.bearing_rad;
    const bool inner = std::abs(std::sin(psi)) * (fit.range_m + fit.radius_m) <= edge_cut * fit.radius_m;
    if (inner) points.emplace_back(beam.range_m * std::cos(psi), beam.range_m * std::sin(psi));
  }
  const auto count = static_cast<Eigen::Index>(points.size());
  most_hits_ = std::max(most_hits_, static_cast<int>(count));
  if (count < 3) return;
  Eigen::MatrixX2d line(count, 2), bend(count, 2);
  Eigen::VectorXd depth(count);
  for (Eigen::Index i = 0; i < count; ++i) {
    const Eigen::Vector2d& p = points[static_cast<std::size_t>(i)];
    const double R = fit.radius_m, aside = std::clamp(p.y() / R, -1.0, 1.0);
    line.row(i) << 1.0, p.y();
    bend.row(i) << R * (1.0 - std::sqrt(1.0 - aside * aside)), R * aside * aside * aside;
    depth(i) = p.x();
  }
  bend -= line * line.colPivHouseholderQr().solve(bend);  // what no straight line can take
  information_ += bend.transpose() * bend / (sigma_m * sigma_m);
  moment_ += bend.transpose() * depth / (sigma_m * sigma_m);
}

Roundness::Shape Roundness::shape() const {
  const double none = std::numeric_limits<double>::infinity();
  if (!(information_(0, 0) > 0.0)) return {0.0, none, 0.0, none};
  const Eigen::Matrix2d covariance = information_.inverse();
  const Eigen::Vector2d estimate = covariance * moment_;
  return {estimate(0), std::sqrt(covariance(0, 0)), estimate(1), std::sqrt(covariance(1, 1))};
}

}  // namespace rangecal
