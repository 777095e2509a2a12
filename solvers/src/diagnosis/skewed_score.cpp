// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/skewed_score.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal::diagnosis {

std::vector<double> third_cumulants(const std::vector<Eigen::VectorXd>& columns, const Eigen::VectorXd& dof) {
  std::vector<double> kappa;
  kappa.reserve(columns.size() * columns.size() * columns.size());
  for (const Eigen::VectorXd& a : columns)
    for (const Eigen::VectorXd& b : columns) {
      const Eigen::VectorXd weighed = dof.cwiseProduct(a).cwiseProduct(b);
      for (const Eigen::VectorXd& c : columns) kappa.push_back(weighed.dot(c));
    }
  return kappa;
}

double skewed_chi_square(const Eigen::VectorXd& scores, const std::vector<double>& third_cumulants) {
  const double chi_sq = scores.squaredNorm();
  if (!(chi_sq > 0.0)) return 0.0;
  double cube = 0.0;
  std::size_t at = 0;
  for (const double a : scores)
    for (const double b : scores)
      for (const double c : scores) cube += third_cumulants[at++] * a * b * c;
  const double length = std::sqrt(chi_sq), gamma = cube / (length * chi_sq);
  if (!(gamma > 1e-6)) return chi_sq;
  const double z = 6.0 / gamma * (std::cbrt(1.0 + 0.5 * gamma * length) - 1.0) + gamma / 6.0;
  return std::min(chi_sq, z * z);
}

}  // namespace rangecal::diagnosis
