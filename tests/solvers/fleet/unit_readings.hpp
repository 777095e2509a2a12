// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal::testing {

/// Pairs of a unit with theta = (alpha_0 .. alpha_2, log sigma), noise sigma f^2, distances from `near_m` to
/// 5 m.
inline Recording unit_readings(const Eigen::VectorXd& theta, double near_m, int count, Random& random) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int i = 0; i < count; ++i) {
    const double d = random.uniform(near_m, 5.0), f = evaluate_polynomial(Eigen::VectorXd(theta.head(3)), d);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(random.normal(f, std::exp(theta[3]) * f * f));
  }
  return recording;
}

}  // namespace rangecal::testing
