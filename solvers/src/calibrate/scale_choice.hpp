// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal {

/// Where the readings of the farthest third of the distances lie below those of the nearest (medians): they are no
/// distances then, but fall with it as the voltage of a triangulating sensor does.
bool readings_fall(std::span<const double> true_m, std::span<const double> reading_m);

/// The reciprocal curve of lowest criterion over orders and noise laws, each with its own offset c by maximum likelihood; of
/// orders within 4 of it the lowest: the criterion alone takes one too many in one of six.
struct ReciprocalChoice {
  CurveScale scale;
  int order = 1;
  NoiseLaw law = NoiseLaw::constant;
  double value = 0.0;              ///< the criterion [nats], c counted as a parameter
  int order_of_lowest = 1;         ///< of lowest criterion
  std::vector<ModelScore> models;  ///< all that were tried
};

/// Readings [any unit] at known distances [m]. The likelihood of f = sum alpha_i u^i over u = 1 / (d + c) is that of the 2016
/// problem at known "distances" u; over c it is minimised from the best of a grid, c + d_min from a hundredth of the
/// width of the distances to twenty times it. Gaussian noise. None where no fit converges, or a distance is not positive.
/// Cost: some 60 fits for each order and law.
std::optional<ReciprocalChoice> choose_reciprocal(std::span<const double> true_m,
                                                  std::span<const double> reading_m,
                                                  const CalibrateOptions& options);

/// That curve where it was asked for (CalibrateOptions::curve), or where readings fall with the distance and its criterion is
/// lower than that of every polynomial tried. Readings that agree with most others decide, but for Gaussian noise asked for.
std::optional<ReciprocalChoice> reciprocal_due(const Recording& all, const CalibrateOptions& options);

/// The pairs of all recordings as one.
Recording joined(std::span<const Recording> recordings);

/// RMS [m] of readings about a curve of that order by least squares without them: stretches of distance inside the range, a
/// twentieth of the readings each, are left out in turn. A reciprocal's offset is fitted anew each time, from `scale`'s. None
/// where there are fewer than four stretches or a curve is not determined without one.
std::optional<double> rms_of_stretches_left_out(std::span<const double> true_m,
                                                std::span<const double> reading_m, const CurveScale& scale,
                                                int order);

/// The recording with the scale's u in place of the true distances.
Recording on_scale(Recording recording, const CurveScale& scale);

/// A calibration that was made over u, over distances: its range, its scale with the offset's standard deviation, and the
/// offset's uncertainty in the covariance of the curve,
///
///   C = V + var(c) t t^T,   1 / var(c) = sum w (f_c - b^T B)^2,   t = (coefficients in u of f_c) - B,
///
/// with V the covariance given c, f_c = df/dc = -f'(u) u^2, b the powers of u, B = argmin sum w (f_c - b^T B)^2 and
/// w = weight / s^2. Source: the inverse of a partitioned information matrix.
void take_scale(const CurveScale& scale, const Recording& over_distance, std::span<const double> weight,
                Calibration& calibration);

}  // namespace rangecal
