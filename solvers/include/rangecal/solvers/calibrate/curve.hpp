// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

/// f at one true distance, with what its uncertainty makes of it. All in metres.
struct CurvePoint {
  double distance_m = 0.0;          ///< d
  double reading_m = 0.0;           ///< f(d)
  std::optional<double> std_dev_m;  ///< of f(d): sqrt(phi^T cov(alpha) phi), phi = (1, d, .., d^n)
  /// Of f(d), with the choice of order and noise law in it, where they were chosen (Calibration::covariance_with_choice).
  std::optional<double> std_dev_with_choice_m;
  double noise_m = 0.0;  ///< s(d), of one reading
};

/// f(d) and its standard deviation at one distance; none where the calibration has no curve.
std::optional<CurvePoint> curve_point(const Calibration& calibration, double distance_m);

/// f at `count` equally spaced distances over the range fitted, ends included.
std::vector<CurvePoint> curve_points(const Calibration& calibration, int count = 5);

/// How f changed from one calibration to another, over the range of the second [m].
struct CurveChange {
  double largest_m = 0.0;  ///< largest |f2 - f1|
  double rms_m = 0.0;
  struct At {
    double distance_m = 0.0, change_m = 0.0;
    std::optional<double> std_dev_m;
  };
  std::vector<At> at;  ///< five distances
  /// H0: both have the same f. T^2 = delta^T C^+ delta of the coefficients, padded with zeros; chi-square where the noise
  /// is known. C = C_1 + C_2 (different data), each with the choice of order and noise law where the calibration has that
  /// (Calibration::covariance_with_choice), else given its model; where the first has none, C_2 alone, and then H0 is
  /// that the first is exact.
  std::optional<double> chi_sq, p_value;
  int degrees_of_freedom = 0;  ///< r, the rank of C: coefficients compared
  bool first_taken_as_exact = false;
  /// Of F, below the line: nu - r + 1; absent where no calibration says how well its noise is known, and T^2 is then
  /// referred to chi-square.
  std::optional<double> noise_degrees_of_freedom;
  bool given_the_model =
      false;  ///< a covariance does not count the choice of order and law: none was made, or not known
  std::string reason;  ///< why there is no p-value
};

/// The law of T^2 allows for noise that is itself estimated:
///
///   T^2 (nu - r + 1) / (nu r) ~ F(r, nu - r + 1),
///   nu = r (r + 1) / sum_i [ tr(A_i^2) + (tr A_i)^2 ] / nu_i,   A_i = C_i C^+,
///
/// which for one coefficient is Satterthwaite's nu (1946) and Welch's test. Source: Krishnamoorthy, Yu, Modified Nel and
/// Van der Merwe test for the multivariate Behrens-Fisher problem, Statistics and Probability Letters 66, 2004. nu_i, of
/// calibration i: the least of (sigma / std sigma)^2 / 2 of sigma_e and of sigma_theta, of the readings used less the
/// coefficients of f, and of two for each stop where sigma_s was estimated. Unchanged sensors are called changed (p < 0.05)
/// in about 5 % of cases where order and law are given, in fewer from 60 pairs on where they are chosen, and in a little
/// more below (docs/reliability.md).
///
/// No p-value (reason says why): the second has no covariance; the orders differ, and a covariance does not count the
/// choice of the order or does not reach to the higher one: a coefficient taken for zero would count as known to be zero,
/// while the other calibration kept it because it came out large; noise known with too few degrees of freedom.
///
/// Throws InputError where one of them has no curve or the range is empty.
CurveChange compare_curves(const Calibration& before, const Calibration& after);

}  // namespace rangecal
