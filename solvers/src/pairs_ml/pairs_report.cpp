// SPDX-License-Identifier: BSD-3-Clause
#include "pairs_report.hpp"

#include <Eigen/Eigenvalues>
#include <charconv>
#include <cmath>
#include <limits>
#include <string>
#include <system_error>

namespace rangecal::pairs_ml {

std::string name_direction(const Eigen::VectorXd& direction) {
  const double largest = direction.cwiseAbs().maxCoeff();
  std::string text;
  for (Eigen::Index i = 0; i < direction.size(); ++i) {
    if (std::abs(direction[i]) < 1e-4 * largest) continue;
    char
        digits[32];  // to_chars takes a quarter of the time of a formatter, which a fit of few readings feels
    const std::to_chars_result end =
        std::to_chars(digits, digits + sizeof digits, std::abs(direction[i]), std::chars_format::general, 3);
    text += direction[i] < 0.0 ? (text.empty() ? "-" : " - ") : (text.empty() ? "" : " + ");
    text.append(digits, end.ptr).append(" alpha_").append(std::to_string(i));
  }
  return text;
}

std::string weakest_direction(const Matrix& alpha_covariance, double reference_m) {
  const Eigen::Index n = alpha_covariance.rows();
  Vector in_metres(n);  // what one unit of alpha_i moves f by at the reference distance
  for (Eigen::Index i = 0; i < n; ++i) in_metres[i] = i == 0 ? 1.0 : in_metres[i - 1] * reference_m;
  const Matrix metric = in_metres.asDiagonal() * alpha_covariance * in_metres.asDiagonal();
  // Its largest eigenvalue by power iteration; an eigenvalue decomposition where another one is close.
  Eigen::Index start = 0;
  metric.diagonal().maxCoeff(&start);
  Vector direction = metric.col(start).normalized(), next(n);
  double largest = 0.0, change = 1.0;
  for (int iteration = 0; iteration < 30 && change > 1e-9; ++iteration) {
    next.noalias() = metric * direction;
    largest = next.norm();
    next /= largest;
    change = (next - direction).norm();
    direction = next;
  }
  if (!(change <= 1e-9)) {
    const Eigen::SelfAdjointEigenSolver<Matrix> eigen(metric);
    largest = std::fmax(0.0, eigen.eigenvalues()[n - 1]);
    direction = eigen.eigenvectors().col(n - 1);
  }
  const Eigen::VectorXd step = std::sqrt(largest) * direction.cwiseQuotient(in_metres);
  return name_direction(step) + " (one standard deviation)";
}

Eigen::VectorXd unseen_polynomial(const std::vector<double>& distances) {
  Eigen::VectorXd coefficients = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(distances.size()) + 1);
  coefficients[0] = 1.0;
  Eigen::Index degree = 0;
  for (const double root : distances) {
    for (Eigen::Index j = ++degree; j >= 0; --j) {
      coefficients[j] = (j > 0 ? coefficients[j - 1] : 0.0) - root * coefficients[j];
    }
  }
  return coefficients;
}

void set_covariance(Calibration& calibration, const Matrix& covariance, double reference_m) {
  const Eigen::Index n = calibration.alpha.size(), m = calibration.noise.parameters.size();
  const bool usable =
      covariance.rows() == n + m && covariance.allFinite() && (covariance.diagonal().array() > 0.0).all();
  calibration.noise_estimates.clear();
  for (Eigen::Index j = 0; j < m; ++j) {
    Estimate estimate{calibration.noise.parameters[j], std::nullopt};
    if (usable) estimate.std_dev = std::sqrt(covariance(n + j, n + j));
    calibration.noise_estimates.push_back(estimate);
  }
  if (!usable) {
    calibration.alpha_covariance.reset();
    if (calibration.covariance_reason.empty())
      calibration.covariance_reason = "the information matrix is singular";
    return;
  }
  calibration.alpha_covariance = covariance.topLeftCorner(n, n);
  calibration.weakest_direction = weakest_direction(covariance.topLeftCorner(n, n), reference_m);
}

OrderScore score_order(int order, double nll, int parameters, double readings, Outcome outcome) {
  const double k = parameters;
  OrderScore score;
  score.order = order;
  score.nll = nll;
  score.aic = 2.0 * (nll + k);
  score.aicc = readings - k - 1.0 > 0.0 ? score.aic + 2.0 * k * (k + 1.0) / (readings - k - 1.0)
                                        : std::numeric_limits<double>::infinity();
  score.bic = 2.0 * nll + k * std::log(readings);
  score.outcome = outcome;
  return score;
}

}  // namespace rangecal::pairs_ml
