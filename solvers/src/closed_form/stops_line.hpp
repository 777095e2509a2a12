// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Eigenvalues>
#include <vector>

namespace rangecal {

/// The line through places to stand: their mean, and the axes of their scatter about it.
struct StopsLine {
  explicit StopsLine(const std::vector<Eigen::Vector2d>& stops) {
    for (const Eigen::Vector2d& stop : stops) centre += stop / static_cast<double>(stops.size());
    Eigen::Matrix2d scatter = Eigen::Matrix2d::Zero();
    for (const Eigen::Vector2d& stop : stops) scatter += (stop - centre) * (stop - centre).transpose();
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(scatter);
    across = axes.eigenvectors().col(0);
    along = axes.eigenvectors().col(1);
    across_square = axes.eigenvalues()[0];
    along_square = axes.eigenvalues()[1];
  }

  Eigen::Vector2d mirrored(const Eigen::Vector2d& m) const {
    return m - 2.0 * across.dot(m - centre) * across;
  }

  Eigen::Vector2d centre = Eigen::Vector2d::Zero(), along, across;
  double along_square, across_square;  ///< sums of squares [m^2]
};

}  // namespace rangecal
