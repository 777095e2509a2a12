// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <numeric>
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

/// A curve that is no polynomial in the distance, with order and noise law, of lowest criterion among those of its family.
struct ScaleChoice {
  CurveScale scale;
  int order = 1;
  NoiseLaw law = NoiseLaw::constant;
  double value = 0.0;              ///< the criterion [nats], the scale's parameters counted
  int order_of_lowest = 1;         ///< of lowest criterion
  std::vector<ModelScore> models;  ///< all that were tried
  Eigen::VectorXd alpha = {};      ///< of a spline: the line in u
  std::string note = {};           ///< what is to be known of it
};

/// Readings [any unit] at known distances [m], Gaussian noise. The likelihood of f = sum alpha_i u^i over u = 1 / (d + c) is
/// that of the 2016 problem with u in place of the known distances. Its negative logarithm is minimised over c from the best
/// point of a grid, on which c + d_min goes from a hundredth of the range of the distances to twenty times that range. If a lower
/// order is within 4 of the lowest criterion, that order is taken: the criterion alone takes an order too high in one case of six.
/// None if no fit converges, or a distance is not positive.
/// Cost: some 60 fits for each order and law.
std::optional<ScaleChoice> choose_reciprocal(std::span<const double> true_m,
                                             std::span<const double> reading_m,
                                             const CalibrateOptions& options);

/// The same over the scale of a smoothing spline (smoothing_spline.hpp), one for each noise law: readings are weighted by the law at the
/// spline before, from that of equal weights. Its effective degrees of freedom count as parameters.
std::optional<ScaleChoice> choose_spline(std::span<const double> true_m, std::span<const double> reading_m,
                                         const CalibrateOptions& options);

/// A reciprocal if it was asked for (CalibrateOptions::curve), or if readings fall with the distance and its criterion is
/// lower than that of every polynomial tried. Only readings that agree with most others count, unless Gaussian noise was
/// asked for.
std::optional<ScaleChoice> reciprocal_due(const Recording& all, const CalibrateOptions& options);

/// The spline that was asked for (CalibrateOptions::curve), of the same readings. Throws InputError where there is none.
ScaleChoice asked_spline(const Recording& all, const CalibrateOptions& options);

/// The pairs of all recordings as one.
Recording joined(std::span<const Recording> recordings);

/// Errors of readings of stretches of distance that were left out in turn, one entry for each stretch.
struct LeftOutStretches {
  std::vector<double> mean_square, readings;  ///< weighted [m^2]; number
  double rms() const {
    return std::sqrt(std::inner_product(mean_square.begin(), mean_square.end(), readings.begin(), 0.0) /
                     std::accumulate(readings.begin(), readings.end(), 0.0));
  }
};

/// About a curve of that order fitted to the others by weighted least squares (no `weights`: equal ones). Stretches of distance inside the
/// range, a twentieth of the readings each, are left out in turn. A reciprocal's offset is fitted again each time, starting
/// from that of `scale`, a spline from nothing. None if there are fewer than four stretches, or if a curve is not determined without one.
std::optional<LeftOutStretches> stretches_left_out(std::span<const double> true_m,
                                                   std::span<const double> reading_m,
                                                   std::span<const double> weights, const CurveScale& scale,
                                                   int order);

/// True if a spline predicts stretches left out better than another curve does, each reading weighed by its noise, by more than two
/// standard errors of the mean over the stretches. AIC takes readings for independent: where they depend on each other it follows
/// what they have in common.
bool spline_predicts_better(const Pairs& pairs, const ScaleChoice& spline, const CurveScale& other,
                            int order);

/// The recording with the scale's u in place of the true distances.
Recording on_scale(Recording recording, const CurveScale& scale);

/// Turns a calibration that was made over u into one over distances: sets its range and its scale, a reciprocal's with the offset's
/// standard deviation, and adds the offset's uncertainty to the covariance of the curve,
///
///   C = V + var(c) t t^T,   1 / var(c) = sum w (f_c - b^T B)^2,   t = (coefficients in u of f_c) - B,
///
/// with V the covariance given c, f_c = df/dc = -f'(u) u^2, b the powers of u, B = argmin sum w (f_c - b^T B)^2 and
/// w = weight / s^2. Source: the inverse of a partitioned information matrix.
void take_scale(const CurveScale& scale, const Recording& over_distance, std::span<const double> weight,
                Calibration& calibration);

}  // namespace rangecal
