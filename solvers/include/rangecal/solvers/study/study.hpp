// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <initializer_list>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"
#include "rangecal/solvers/closed_form/noise_order.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

namespace rangecal {

/// What a study reports of every (point, estimator). docs/study.md lists the columns of each.
enum class StudyMeasure {
  bias,             ///< of landmarks and curve
  variance,         ///< of landmarks and curve
  rmse,             ///< of landmarks and curve
  rmse_over_bound,  ///< RMSE over the square root of the Cramer-Rao bound
  mse_ratio,        ///< MSE(d, d~) / MSE(d, d^) on readings of their own (2021 eq. 31)
  normalised_mse,   ///< before and after, and their factor (2016 eq. 31, 32)
  order,            ///< how often each order of f was selected
  aic,              ///< mean AIC by order (2016 Table 1), kind pairs
  noise_order,      ///< how often H0 .. H3 has the highest likelihood (2016 eq. 10-16), kind pairs
  coverage,         ///< of 95 % intervals
  sigmas,           ///< estimated over true
  failures,         ///< repeats by outcome
  time              ///< seconds per repeat; kept in a table of their own
};
const char* to_string(StudyMeasure measure);

/// One way to estimate. `label` names its rows.
struct StudyEstimator {
  std::string label;
  Method method = Method::closed_form;
  bool noise_order = false;                             ///< not a calibration: the power of the noise (pairs)
  BearingWeights weights = BearingWeights::consistent;  ///< closed-form
  DifferenceDivisor divisor = DifferenceDivisor::unbiased;  ///< noise-order
  std::optional<int> order;                                 ///< of f; absent: selected
  OrderCriterion criterion = OrderCriterion::aic;  ///< of that selection; others than AIC: closed-form only
};

/// One axis of the grid: a parameter of the scene and the values that it takes, numbers in their shortest text.
struct StudyParameter {
  std::string name;
  std::vector<std::string> values;
};

/// One combination of the grid.
struct StudyPoint {
  std::vector<std::string> values;  ///< one per parameter
  std::string key;                  ///< "sigma_theta_deg=2,sigma_s_m=0.01"
  Scene scene;
  std::optional<int> order;  ///< of f, where `fit_order` is a parameter
};

/// A Monte-Carlo study: a scene, a grid over its parameters, repeats, estimators, measures.
struct Study {
  std::string name;
  std::vector<std::string> files;  ///< that it was read from: its own and its scenes'
  std::vector<StudyParameter> grid;
  std::vector<StudyPoint> points;  ///< every combination; the last parameter varies fastest
  int repeats = 0;                 ///< of every point
  int piece = 20;                  ///< repeats that are run, written down and lost together
  int max_order = 4;               ///< highest order tried where it is selected
  std::optional<NoiseLaw> noise;   ///< law fitted; absent: the scene's
  std::vector<StudyEstimator> estimators;
  std::vector<StudyMeasure> measures;
  std::vector<double> curve_m;    ///< distances at which the curve is measured
  std::uint64_t fingerprint = 0;  ///< of all that the numbers depend on, except `repeats`

  bool measures_any(std::initializer_list<StudyMeasure> wanted) const;
};

/// Reads a study file (docs/study.md, docs/study.schema.json). Scenes are found from the file's folder. Throws
/// InputError naming file, row and field for anything missing, malformed, unknown or impossible together.
Study load_study(const std::string& path);

/// The scene with one parameter changed; docs/study.md lists the parameters. Throws InputError (no file named)
/// for an unknown parameter, or a value that the scene cannot take.
Scene with_parameter(Scene scene, const std::string& parameter, const std::string& value);

/// K stops evenly over the path from the first stop to the last.
Scene with_stops(Scene scene, int count);

/// The seed of a repeat: of nothing but study, point and repeat. `purpose` tells the readings to calibrate on from
/// those to test on.
std::uint64_t study_seed(const Study& study, const StudyPoint& point, int repeat, const char* purpose);

}  // namespace rangecal
