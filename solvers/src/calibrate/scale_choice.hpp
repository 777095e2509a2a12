// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal {

/// True if the median reading over the farthest third of the distances is below that over the nearest third. Such readings
/// are not distances; they fall with distance, as the voltage of a triangulating sensor does.
bool readings_fall(std::span<const double> true_m, std::span<const double> reading_m);

/// The reciprocal curve of lowest criterion over orders and noise laws, each with its own offset c by maximum likelihood. If a
/// lower order is within 4 of it, that order is taken: the criterion alone takes an order too high in one case of six.
struct ReciprocalChoice {
  CurveScale scale;
  int order = 1;
  NoiseLaw law = NoiseLaw::constant;
  double value = 0.0;              ///< the criterion [nats], c counted as a parameter
  int order_of_lowest = 1;         ///< of lowest criterion
  std::vector<ModelScore> models;  ///< all that were tried
};

/// Readings [any unit] at known distances [m], Gaussian noise. The likelihood of f = sum alpha_i u^i over u = 1 / (d + c) is
/// that of the 2016 problem with u in place of the known distances. Its negative logarithm is minimised over c from the best
/// point of a grid, on which c + d_min goes from a hundredth of the range of the distances to twenty times that range. None if
/// no fit converges, or a distance is not positive.
/// Cost: some 60 fits for each order and law.
std::optional<ReciprocalChoice> choose_reciprocal(std::span<const double> true_m,
                                                  std::span<const double> reading_m,
                                                  const CalibrateOptions& options);

/// That curve if it was asked for (CalibrateOptions::curve), or if readings fall with the distance and its criterion is
/// lower than that of every polynomial tried. Only readings that agree with most others count, unless Gaussian noise was
/// asked for.
std::optional<ReciprocalChoice> reciprocal_due(const Recording& all, const CalibrateOptions& options);

/// The pairs of all recordings as one.
Recording joined(std::span<const Recording> recordings);

/// RMS [m] of held-out readings about a curve of that order fitted to the others by least squares. Stretches of distance inside
/// the range, a twentieth of the readings each, are left out in turn. A reciprocal's offset is fitted again each time, starting
/// from that of `scale`. None if there are fewer than four stretches, or if a curve is not determined without one.
std::optional<double> rms_of_stretches_left_out(std::span<const double> true_m,
                                                std::span<const double> reading_m, const CurveScale& scale,
                                                int order);

/// The recording with the scale's u in place of the true distances.
Recording on_scale(Recording recording, const CurveScale& scale);

/// Turns a calibration that was made over u into one over distances: sets its range, its scale with the offset's standard
/// deviation, and adds the offset's uncertainty to the covariance of the curve,
///
///   C = V + var(c) t t^T,   1 / var(c) = sum w (f_c - b^T B)^2,   t = (coefficients in u of f_c) - B,
///
/// with V the covariance given c, f_c = df/dc = -f'(u) u^2, b the powers of u, B = argmin sum w (f_c - b^T B)^2 and
/// w = weight / s^2. Source: the inverse of a partitioned information matrix.
void take_scale(const CurveScale& scale, const Recording& over_distance, std::span<const double> weight,
                Calibration& calibration);

}  // namespace rangecal
