// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "rangecal/solvers/recursive/distance_moments.hpp"
#include "rangecal/solvers/recursive/residual_cells.hpp"

namespace rangecal {

class JsonFields;

struct RecursiveOptions {
  double range_min_m = 0.05, range_max_m = 50.0;  ///< true distances taken; others are counted as dropped
  std::optional<int> order = 2;  ///< of f; nullopt: the lowest AIC of 1 .. max_order at each estimate
  int max_order = 4;             ///< of that search
  NoiseLaw law =
      NoiseLaw::f_squared;  ///< of the full likelihood; the approximate one has f_squared for polynomial
  int noise_order = 1;      ///< of the noise polynomial, law `polynomial` only
  /// Of the full likelihood; `automatic`: chosen anew, with an order that is, as often as the readings have
  /// doubled.
  NoiseShape noise_shape = NoiseShape::automatic;
  /// Time constant: a reading counts by w = exp(-age / forget). Age in seconds where the readings have times, else in
  /// readings; infinite: nothing is forgotten.
  double forget = std::numeric_limits<double>::infinity();

  /// Throws InputError naming the bad field and its value.
  void check() const;
  int columns() const { return order.value_or(max_order) + 1; }
  int noise_count() const { return parameter_count(law, noise_order); }
};

/// Calibrates from pairs (true distance d, reading y) one at a time, in memory that does not depend on their number
/// (Alhashimi 2016, section 6, asks for it). All distances in metres.
///
/// Approximate model (2016 eq. 21-25), y / d^2 = sum_i alpha_i d^(i-2) + e, in square-root information form: the
/// triangle S of the QR decomposition of the weighted rows sqrt(w) (d^-2, .., d^(n-2), y d^-2) takes each row by Givens
/// rotations,
///
///   [ S ]        [ S' ]        S = [ R  z   ]      R alpha = z,   rho^2 = the sum of squared residuals,
///   [ row ] = Q  [ 0  ],           [ 0  rho ]      (R^T R)^-1 the cofactor of alpha,
///
/// which is the batch's answer to rounding, and that of every lower order besides: its columns come first.
///
/// Full likelihood (2016 eq. 17-20) of Gaussian noise: sums over readings of log s and (y - f)^2 / s^2 are taken from the
/// DistanceMoments to 1e-7 of themselves or better and minimised by Newton's method from the last estimate. The batch's
/// answer within 1 % of its standard deviation, for every order and law afterwards.
///
/// Of other noise shapes: full_pairs on the points of ResidualCells, from the last estimate; the batch's answer within 5 %
/// of its standard deviation.
///
/// With forgetting both covariances are H^-1 J H^-1: H = sum w i, J = sum w^2 i, i the information of a reading (of the
/// approximate model: i of H by its weights d^-4, of J by these and the spread estimated).
class RecursiveCalibrator {
 public:
  explicit RecursiveCalibrator(const RecursiveOptions& options = {});

  /// Takes one pair; time in seconds, NaN where there is none (all or no readings have one). False, with the reason
  /// counted, for a reading that is not finite, zero or negative, or a distance outside the range. Times may go back.
  /// Cost: constant, some 0.1 us.
  bool add(double true_m, double reading_m, double time_s = std::numeric_limits<double>::quiet_NaN());

  /// The approximate model's answer, noise as approximate_pairs. Outcomes: converged; too_few_data; unobservable.
  Calibration approximate() const;
  /// The maximum of the full likelihood. Outcomes: also unbounded, not_converged. Cost: some 0.2 ms, of another shape than
  /// the Gaussian some 2 ms, the choice of a shape some 20 ms.
  Calibration full();

  const RecursiveOptions& options() const { return options_; }
  const Counts& counts() const { return counts_; }
  std::int64_t used() const { return moments_.used; }
  double effective_readings() const;  ///< (sum w)^2 / sum w^2

  /// `rangecal-recursive/2`: the whole state as JSON; doubles survive bit by bit.
  std::string to_json() const;
  /// Takes states of version 1 too, which know Gaussian noise alone. Throws InputError naming `name` and the field for a
  /// text that is no such state.
  static RecursiveCalibrator from_json(const std::string& text, const std::string& name);

 private:
  friend void fields(JsonFields& json, RecursiveCalibrator& tracked);  ///< of the state
  bool looks_for_outliers() const { return options_.noise_shape != NoiseShape::gaussian; }
  void rescale(double log_factor);
  Calibration full_gaussian();
  std::optional<Calibration> full_with_shape();
  std::optional<Calibration> maximise(int order, const Calibration* start) const;
  std::optional<Eigen::VectorXd> noise_start(int order, Eigen::VectorXd& alpha, Outcome& outcome) const;

  RecursiveOptions options_;
  DistanceMoments moments_;
  Eigen::MatrixXd triangle_;         ///< S, columns() + 1 square, with the row to be taken as its last
  double origin_ = 0.0, now_ = 0.0;  ///< weight 1 at time `origin`; the latest time
  double sum_w_ = 0.0, sum_w_sq_ = 0.0;
  double low_m_ = 0.0, high_m_ = 0.0;  ///< smallest and largest d taken
  std::optional<bool> timed_;
  Counts counts_;
  Eigen::VectorXd last_alpha_;  ///< start of the next solve
  Eigen::VectorXd last_noise_;
  ResidualCells cells_;              ///< empty while noise is Gaussian by option
  NoiseShapeParameters last_shape_;  ///< of the last estimate
  std::int64_t choose_at_ = 0;       ///< readings used from which on shape and order are chosen anew
};

}  // namespace rangecal
