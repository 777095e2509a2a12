// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// What a model says of readings that it was not fitted to.
struct HeldOut {
  double nll = 0.0;           ///< of all that was left out, each fold given the rest [nats]
  std::vector<double> parts;  ///< of parts of it, whose scatter gives the standard error
  /// Of pairs: sum over cells of (mean reading - predicted)^2 [m^2], and their number.
  double squares = 0.0, cells = 0.0;
  bool ok = true;  ///< false: a training part could not be fitted, or predicts nothing
};

/// The parts together.
HeldOut sum_of(const std::vector<HeldOut>& parts);

/// Adds the squares of the cells of pairs marked `out`, under a model fitted without them; nothing for landmarks, whose
/// distances are not known.
void add_squares(const Rows& rows, const std::vector<char>& out, const Model& model, const JointState& state,
                 HeldOut& held);

/// The model fitted on a training part, from the fit to all readings (its stops and landmarks those of `rest`). Linear
/// parameters that change no reading of the part, such as a device's that was left out, are 0.
/// Parameters of means and variances move by `iterations` steps at most; dependence and tails, which have no
/// score, by one parabola through three values of l_s each.
Fit fit_part(const Rows& rest, const Fit& full, RefitOptions options, int iterations);

}  // namespace rangecal::diagnosis
