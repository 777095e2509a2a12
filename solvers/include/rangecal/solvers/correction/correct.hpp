// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

/// Standard deviations from which on a distance does not explain a reading: noise does that once in 16 000 readings.
inline constexpr double farthest_off = 4.0;

/// A distance that explains a reading.
struct CorrectionRoot {
  double distance_m = 0.0;
  std::optional<double> std_dev_m;        ///< s(d) / |f'(d)|; absent at a turning point of f
  std::optional<double> std_dev_total_m;  ///< sqrt(s^2 + var f(d)) / |f'|, by `curve_variance`;
                                          ///< absent there, and where the calibration has no covariance
  double log_likelihood = 0.0;            ///< log p(reading | d) under the noise law [nats]
  double off = 0.0;                       ///< |reading - f(d)| / sqrt(s^2 + var f(d)); infinite without noise
  bool extrapolated = false;              ///< outside the distances over which f was fitted
  bool turning_point = false;             ///< f'(d) = 0: the reading lies beyond what f reaches here
};

/// Every plausible distance behind one reading, by least squares and by maximum likelihood, each ascending in
/// d.
struct Correction {
  Outcome outcome = Outcome::failed;  ///< converged: a root was found; failed: none, see `nearest`
  std::string reason;
  std::vector<CorrectionRoot> least_squares;       ///< roots of f(d) = y (2016 eq. 30; 2021 eq. 29, 30)
  std::vector<CorrectionRoot> maximum_likelihood;  ///< local minima of the NLL of y (2016 eq. 27-29)
  int best_least_squares = -1;                     ///< index of the most likely one; -1 if there is none
  int best_maximum_likelihood = -1;
  /// Where f(d) = y has no root in range: argmin |f(d) - y| in it. It explains the reading only if `off` is small.
  std::optional<CorrectionRoot> nearest;
};

/// Whether a distance [m] lies outside those over which f was fitted.
bool is_extrapolated(const Calibration& calibration, double distance_m);

struct CorrectionOptions {
  double extension =
      0.1;  ///< roots are sought this fraction of the fitted range beyond either end; d > 0 always
};

/// Distances d [m] from the sensor to the surface that a raw reading y [m] may stand for, given f and the
/// noise law:
///   least squares:       f(d) = y
///   maximum likelihood:  minima over d of log s + (y - f)^2 / (2 s^2):
///     s = sigma f^2:  (y - f)(2 y - f) = 2 sigma^2 f^4,
///                     a quartic in f for every order; then f(d) = f is inverted (ours)
///     s = sigma d^2:  (y - f)(y - f + d f' / 2) = sigma^2 d^4,
///                     a polynomial in d, a quartic up to order 2 (2016 eq. 27-29)
///     other laws:     zeros of the derivative, bracketed on a grid and at the turning points of f, bisected
/// Minima where f'(d) = 0 are reported as turning points. Sources: 2016 eq. 27-30, 2021 eq. 29-30.
///
/// Effects of the calibration are not undone here. Throws InputError for a reading that is not finite and
/// positive, an empty alpha, or a fitted range that is not 0 <= min < max. Cost: constant.
Correction correct(const Calibration& calibration, double reading_m, const CorrectionOptions& options = {});

/// The most likely least-squares distance [m] of correct()'s answer, `nearest` where there is none, at a tenth of its cost.
double least_squares_distance(const Calibration& calibration, double reading_m,
                              const CorrectionOptions& options = {});

}  // namespace rangecal
