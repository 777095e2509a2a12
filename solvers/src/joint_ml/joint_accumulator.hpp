// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <vector>

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// What one part of the nodes adds to the globals' own blocks, laid out for the loop over cells.
///
/// curve: the m = alpha_count + tau_count parameters of f and s. For the power laws the alpha block is a Hankel matrix
/// of moments; here it is kept as the full upper triangle, row by row.
struct JointSystem::Accumulator {
  explicit Accumulator(const JointLayout& layout, int landmarks)
      : m(layout.alpha_count + layout.tau_count),
        stride(5 + 2 * m + 2),
        curve_gradient(m),
        curve_hessian(m * m),
        landmark(static_cast<std::size_t>(stride) * landmarks) {}

  void clear() {
    std::fill(curve_gradient.begin(), curve_gradient.end(), 0.0);
    std::fill(curve_hessian.begin(), curve_hessian.end(), 0.0);
    std::fill(landmark.begin(), landmark.end(), 0.0);
    nll = bearing_gradient = bearing_hessian = sigma_s_gradient = sigma_s_hessian = 0.0;
  }
  void add(const Accumulator& other) {
    for (std::size_t i = 0; i < curve_gradient.size(); ++i) curve_gradient[i] += other.curve_gradient[i];
    for (std::size_t i = 0; i < curve_hessian.size(); ++i) curve_hessian[i] += other.curve_hessian[i];
    for (std::size_t i = 0; i < landmark.size(); ++i) landmark[i] += other.landmark[i];
    nll += other.nll;
    bearing_gradient += other.bearing_gradient;
    bearing_hessian += other.bearing_hessian;
    sigma_s_gradient += other.sigma_s_gradient;
    sigma_s_hessian += other.sigma_s_hessian;
  }

  int m, stride;
  std::vector<double> curve_gradient, curve_hessian;
  /// Per landmark: gradient x, y; Hessian xx, xy, yy; cross with the curve (x, y per parameter); with log sigma_theta.
  std::vector<double> landmark;
  double nll = 0.0, bearing_gradient = 0.0, bearing_hessian = 0.0, sigma_s_gradient = 0.0,
         sigma_s_hessian = 0.0;
};

/// What the elimination of one part of the nodes takes from the globals' blocks.
struct JointSystem::Elimination {
  Eigen::MatrixXd schur;  ///< upper triangle
  Eigen::VectorXd reduced;
  std::vector<double> half, zeros;  ///< (L^-1 G, L^-1 g) of one node, row by row
  // W^T W of the nodes in a row that see the same landmarks, over their own columns: upper triangle, row by row.
  std::vector<double> own;
  std::vector<int> landmarks;
  int columns = 0;
  std::size_t stride = 0;
  double log_det = 0.0;
  bool ok = true;
};

/// Bearing error b - (atan2(v) - h), wrapped, from the direction (cos, sin) of b + h: a series for small ones.
inline double bearing_error(double cosine, double sine, double vx, double vy) {
  const double across = sine * vx - cosine * vy, along = cosine * vx + sine * vy;
  if (!(std::abs(across) < 0.08 * along)) return std::atan2(across, along);
  const double t = across / along, t2 = t * t;  // the first term left out is t^17 / 17: 1e-19 t
  return t *
         (1.0 + t2 * (-1.0 / 3 +
                      t2 * (1.0 / 5 +
                            t2 * (-1.0 / 7 +
                                  t2 * (1.0 / 9 + t2 * (-1.0 / 11 + t2 * (1.0 / 13 - t2 * (1.0 / 15))))))));
}

/// Nodes are cut into this many parts, whatever the number of threads, so that sums keep their bits.
inline int part_count(std::size_t nodes) { return nodes < 1024 ? 1 : 16; }

}  // namespace rangecal
