// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/formula_effect.hpp"

namespace rangecal {

/// What another recording says of a law that was found elsewhere.
enum class LawVerdict {
  confirmed,     ///< it acts here, in the size that was found
  another_size,  ///< it acts here, in another size
  refuted,       ///< it would show here, and does not
  not_tested     ///< with it and without it these readings would be alike
};
/// "confirmed", "another_size", "refuted", "not_tested".
const char* to_string(LawVerdict verdict);

/// With a law g(.; p) of parameters p that were found elsewhere and are held, the recording's readings are those of its own
/// calibration plus s g. The size s is fitted with the calibration by marginal ML:
///
///   confirmed      s is 3 standard deviations or more above 0, and within 3 of 1
///   another size   it is above 0 so, but not near 1
///   refuted        it is 3 or more below 1, and not above 0 so
///   not tested     neither
///
/// Of s - 1 the standard deviation counts what p was uncertain by: its part along g, sum_j (<dg/dp_j, g> / <g, g>)^2 var p_j.
struct LawPrediction {
  LawVerdict verdict = LawVerdict::not_tested;
  double size = 0.0, size_std = 0.0;
  double found_std = 0.0;  ///< what 1 is uncertain by, from where the law was found
  /// Negative log predictive density of blocks left out (docs/diagnosis.md) under the seed model, less that with the law at s = 1,
  /// nothing but the calibration fitted: above 0 it predicts better [nats]; and the standard error of that.
  std::optional<double> heldout_gain, heldout_gain_std;
  /// The same, of the law over a smooth curve along its covariate that is fitted to this recording.
  std::optional<double> heldout_gain_over_curve, heldout_gain_over_curve_std;
  std::string reason;  ///< why it cannot be asked; empty where it was
  /// Of `not_tested`: what would test it, "readings with b from 0.84 to 1.52 rad (3 of 1440 here)", where the law acts in a part of what
  /// it depends on; else empty.
  std::string would_test;
  /// And how many times as many readings like these would tell 0 from 1 by 6 standard deviations, so that either answer has 3; none where no
  /// number would, for the law's own uncertainty from where it was found.
  std::optional<double> times_the_readings;
};

/// Throws InputError for recordings that cannot be diagnosed, and std::invalid_argument for an effect that changes no mean and no
/// variance of readings, or values of another number than it has parameters. Cost: some fits of the calibration.
LawPrediction predict_law(const Effect& law, const StatedValues& values,
                          std::span<const Recording> recordings);

}  // namespace rangecal
