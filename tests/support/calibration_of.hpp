// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <utility>

#include "rangecal/core/calibration.hpp"

namespace rangecal::testing {

/// A converged calibration of one sigma [m], from `low` to `high` [m].
inline Calibration calibration_of(Eigen::VectorXd alpha, NoiseLaw law, double sigma, double low = 0.3,
                                  double high = 5.0) {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = std::move(alpha);
  c.noise = {law, Eigen::VectorXd::Constant(1, sigma)};
  c.range_min_m = low;
  c.range_max_m = high;
  return c;
}

}  // namespace rangecal::testing
