// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/curve.hpp"

#include <cmath>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal {
namespace {

Eigen::MatrixXd padded(const std::optional<Eigen::MatrixXd>& covariance, Eigen::Index size) {
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(size, size);
  if (covariance) whole.topLeftCorner(covariance->rows(), covariance->cols()) = *covariance;
  return whole;
}

/// delta^T C^+ delta after scaling C to a unit diagonal; the rank goes to `rank`.
double chi_square(const Eigen::VectorXd& delta, const Eigen::MatrixXd& covariance, int& rank) {
  Eigen::VectorXd scale = covariance.diagonal().cwiseMax(0.0).cwiseSqrt();
  for (double& s : scale) s = s > 0.0 ? 1.0 / s : 0.0;
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * covariance * scale.asDiagonal());
  const Eigen::VectorXd turned = eigen.vectors.transpose() * scale.cwiseProduct(delta);
  double sum = 0.0;
  rank = 0;
  for (Eigen::Index i = 0; i < turned.size(); ++i) {
    if (!(eigen.values[i] > 1e-12)) continue;
    sum += turned[i] * turned[i] / eigen.values[i];
    ++rank;
  }
  return sum;
}

}  // namespace

std::optional<CurvePoint> curve_point(const Calibration& calibration, double distance_m) {
  if (calibration.alpha.size() == 0 || !calibration.alpha.allFinite()) return std::nullopt;
  CurvePoint point;
  point.distance_m = distance_m;
  point.reading_m = evaluate_polynomial(calibration.alpha, distance_m);
  point.noise_m = calibration.noise.spread(distance_m, point.reading_m);
  if (calibration.alpha_covariance)
    point.std_dev_m = std::sqrt(evaluate_form(*calibration.alpha_covariance, distance_m));
  if (calibration.covariance_with_choice)
    point.std_dev_with_choice_m = std::sqrt(evaluate_form(*calibration.covariance_with_choice, distance_m));
  return point;
}

std::vector<CurvePoint> curve_points(const Calibration& calibration, int count) {
  std::vector<CurvePoint> points;
  const double low = calibration.range_min_m, high = calibration.range_max_m;
  for (int i = 0; i < count; ++i)
    if (const auto point = curve_point(calibration, low + (high - low) * i / std::max(1, count - 1)))
      points.push_back(*point);
  return points;
}

CurveChange compare_curves(const Calibration& before, const Calibration& after) {
  if (before.alpha.size() == 0 || !before.alpha.allFinite())
    throw InputError("the calibration before has no curve f");
  if (after.alpha.size() == 0 || !after.alpha.allFinite())
    throw InputError("the calibration after has no curve f");
  const double low = after.range_min_m, high = after.range_max_m;
  if (!(low >= 0.0) || !(high > low)) throw InputError("the range fitted by the calibration after is empty");

  const Eigen::Index size = std::max(before.alpha.size(), after.alpha.size());
  Eigen::VectorXd delta = Eigen::VectorXd::Zero(size);
  delta.head(after.alpha.size()) += after.alpha;
  delta.head(before.alpha.size()) -= before.alpha;
  CurveChange change;
  std::optional<Eigen::MatrixXd> covariance;
  if (after.alpha_covariance) {
    covariance = padded(after.alpha_covariance, size) + padded(before.alpha_covariance, size);
    change.first_taken_as_exact = !before.alpha_covariance;
  }
  constexpr int grid = 200;
  for (int i = 0; i <= grid; ++i) {
    const double moved = evaluate_polynomial(delta, low + (high - low) * i / grid);
    change.largest_m = std::max(change.largest_m, std::abs(moved));
    change.rms_m += moved * moved / (grid + 1);
  }
  change.rms_m = std::sqrt(change.rms_m);
  for (int i = 0; i < 5; ++i) {
    const double d = low + (high - low) * i / 4.0;
    CurveChange::At at{d, evaluate_polynomial(delta, d), std::nullopt};
    if (covariance) at.std_dev_m = std::sqrt(evaluate_form(*covariance, d));
    change.at.push_back(at);
  }
  if (covariance) {
    const double chi_sq = chi_square(delta, *covariance, change.degrees_of_freedom);
    if (change.degrees_of_freedom > 0) {
      change.chi_sq = chi_sq;
      change.p_value = std::isfinite(chi_sq) ? chi_squared_upper(chi_sq, change.degrees_of_freedom) : 0.0;
    }
  }
  return change;
}

}  // namespace rangecal
