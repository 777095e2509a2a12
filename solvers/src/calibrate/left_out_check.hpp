// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calibrate/stop_influence.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Readings of stops that were left out, against distances that no range told: from the commanded stop to the landmark
/// that the bearings of the other stops place (2021, eq. 18-23). Of each cell of R readings, mean y and mean square
/// deviation S^2, per reading:
///
///   raw        (y - d)^2 + S^2
///   corrected  (f^-1(y) - d)^2 + S^2 / f'^2,      f by the readings of the other stops; the raw one where f has no
///              root near d.
struct LeftOutErrors {
  /// Per group of stops: sums over its readings of raw and corrected squares, and their number.
  std::vector<double> raw_sq, corrected_sq, readings;
  /// The same, each reading weighed by 1 / (s^2 / R + var d): where near readings decide, not the noise of far ones.
  std::vector<double> raw_weighted, corrected_weighted;
};

/// `agreeing`: cells of readings that are no gross outliers, weighed by the curve and noise of `weighed_by`. Cells of landmarks
/// that bearings do not determine without the group are left out of both.
LeftOutErrors left_out_errors(const JointProblem& agreeing, const JointState& state,
                              const StopInfluence& influence, const JointState& weighed_by);

/// Readings at known distances d [m], in the order of the recordings.
struct KnownReadings {
  std::span<const double> true_m, reading_m;
  std::span<const double> weight;  ///< robust weights, one per reading
  std::span<const char> judged;    ///< no outlier: its error says something of the curve
  std::span<const int> block;      ///< what is left out with the reading (core/blocks.hpp), from 0
};

/// The same of pairs, their groups the readings' blocks. The curve without a group is that of least squares with the weights w / s^2 of the estimate. `halves`: gets the difference
/// between the curves of the first and the second half of the readings, and its covariance; its groups stay empty.
LeftOutErrors left_out_errors(const KnownReadings& readings, const Calibration& calibration,
                              const Calibration& weighed_by, StopInfluence& halves);

/// How much less of the weighted squares of groups left out `simpler` leaves than `other` does, per group, and the
/// standard error of that; none where they do not judge the same readings.
struct Gain {
  double mean = 0.0, std_dev = 0.0;
};
std::optional<Gain> gain_of(const LeftOutErrors& simpler, const LeftOutErrors& other);
/// True where `simpler` predicts the groups better than `other` does, by more than the standard error of that.
inline bool predicts_better(const LeftOutErrors& simpler, const LeftOutErrors& other) {
  const std::optional<Gain> gain = gain_of(simpler, other);
  return gain && gain->mean > gain->std_dev;
}

/// The verdict: usable where the weighted squares fall by more than chance (one-sided t test over the groups, 2.5 %) and
/// by a tenth, and the plain ones fall at all. None with fewer than four groups.
std::optional<LeftOutCheck> left_out_check(const LeftOutErrors& errors, const StopInfluence* influence,
                                           const std::string& what_was_left_out);

/// Standard deviations by stops over the model's; none where the calibration lacks one of them.
std::optional<MisfitOfDeviations> misfit_of(const Calibration& calibration, int groups);

}  // namespace rangecal
