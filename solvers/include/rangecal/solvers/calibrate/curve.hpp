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
  /// H0: both have the same f. chi^2 = delta^T C^+ delta of the coefficients, with as many degrees of freedom
  /// as C has rank. C is the sum of both covariances (different data), or the second's alone where the first
  /// has none, and then H0 is that the first is exact.
  std::optional<double> chi_sq, p_value;
  int degrees_of_freedom = 0;
  bool first_taken_as_exact = false;
};

/// Throws InputError where one of them has no curve or the range is empty.
CurveChange compare_curves(const Calibration& before, const Calibration& after);

}  // namespace rangecal
