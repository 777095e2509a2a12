// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/wandering_part.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal::diagnosis {

std::pair<double, double> WanderingPart::Prediction::behind(double slope, double curvature) const {
  const double gain = variance / spread;
  return {mean - gain * slope, std::max(0.0, variance - gain * gain * curvature)};
}

WanderingPart::WanderingPart(const Sequence& sequence, double q, double rho)
    : sequence_(sequence), q_(q), rho_(rho) {
  const auto n = static_cast<Eigen::Index>(sequence.order.size());
  mean_.setZero(n);
  variance_.setConstant(n, q);
}

double WanderingPart::correlation(int row) const {
  const auto i = static_cast<std::size_t>(row);
  return sequence_.before[i] < 0 ? 0.0 : std::pow(rho_, sequence_.gap[i]);
}

WanderingPart::Prediction WanderingPart::before(int row) const {
  Prediction prediction{0.0, q_, 1.0};
  const int last = sequence_.before[static_cast<std::size_t>(row)];
  if (last >= 0) {
    const double phi = correlation(row);
    prediction.mean = phi * mean_[last];
    prediction.variance = phi * phi * variance_[last] + q_ * (1.0 - phi * phi);
    prediction.spread = std::sqrt(prediction.variance + 1.0 - q_);
  }
  return prediction;
}

void WanderingPart::leave(int row, double mean, double variance) {
  mean_[row] = mean;
  variance_[row] = variance;
}

}  // namespace rangecal::diagnosis
