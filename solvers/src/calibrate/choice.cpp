// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/choice.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace rangecal {

std::optional<Eigen::MatrixXd> covariance_with_choice(const Calibration& delivered,
                                                      std::span<const TriedCurve> tried) {
  if (!delivered.alpha_covariance) return std::nullopt;
  double lowest = std::numeric_limits<double>::infinity();
  for (const TriedCurve& one : tried) lowest = std::min(lowest, one.aic);
  std::vector<const TriedCurve*> counted;
  Eigen::Index size = delivered.alpha.size();
  for (const TriedCurve& one : tried) {
    if (!std::isfinite(one.aic) || one.aic > lowest + aic_that_matters || !one.covariance) continue;
    counted.push_back(&one);
    size = std::max(size, one.alpha.size());
  }
  if (counted.size() < 2) return std::nullopt;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(size, size);
  double weights = 0.0;
  for (const TriedCurve* one : counted) {
    const double weight = std::exp(-0.5 * (one->aic - lowest));
    const Eigen::Index own = one->alpha.size();
    Eigen::VectorXd delta = Eigen::VectorXd::Zero(size);
    delta.head(own) += one->alpha;
    delta.head(delivered.alpha.size()) -= delivered.alpha;
    sum += weight * delta * delta.transpose();
    sum.topLeftCorner(own, own) += weight * *one->covariance;
    weights += weight;
  }
  return sum / weights;
}

}  // namespace rangecal
