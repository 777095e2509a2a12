// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/wandering_part.hpp"

#include <cmath>

namespace rangecal::diagnosis {

std::pair<double, double> WanderingPart::Prediction::behind(double slope, double curvature) const {
  return {mean - variance / spread() * slope, variance_behind(curvature)};
}

WanderingPart::WanderingPart(const Sequence& sequence, double q, double rho)
    : sequence_(sequence), q_(q), rho_(rho) {
  const auto n = static_cast<Eigen::Index>(sequence.order.size());
  mean_.setZero(n);
  variance_.setConstant(n, q);
}

WanderingPart::Prediction WanderingPart::before(int row) const {
  const auto i = static_cast<std::size_t>(row);
  const int last = sequence_.before[i];
  if (last < 0) return {0.0, q_, q_ + 1.0 - q_};
  const double phi = std::pow(rho_, sequence_.gap[i]);
  const double variance = phi * phi * variance_[last] + q_ * (1.0 - phi * phi);
  return {phi * mean_[last], variance, variance + 1.0 - q_, phi};
}

void WanderingPart::leave(int row, double mean, double variance) {
  mean_[row] = mean;
  variance_[row] = variance;
}

}  // namespace rangecal::diagnosis
