// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// What a model says of readings that it was not fitted to.
struct HeldOut {
  double nll = 0.0;           ///< of all that was left out, each fold given the rest [nats]
  std::vector<double> parts;  ///< of parts of it, whose scatter gives the standard error
  bool ok = true;             ///< false: a training part could not be fitted, or predicts nothing
};

/// The parts together.
HeldOut sum_of(const std::vector<HeldOut>& parts);

/// The model fitted on a training part, from the fit to all readings (its stops and landmarks those of `rest`).
/// Parameters of means and variances move by `iterations` steps at most; dependence and tails, which have no
/// score, by one parabola through three values of l_s each.
Fit fit_part(const Rows& rest, const Fit& full, RefitOptions options, int iterations);

}  // namespace rangecal::diagnosis
