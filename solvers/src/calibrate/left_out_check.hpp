// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "calibrate/landmark_influence.hpp"
#include "calibrate/reference_distances.hpp"
#include "calibrate/stop_influence.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Errors of the readings of held-out stops, against reference distances d that use no range (reference_distances.hpp). For a
/// cell of W readings (the sum of their weights) with mean y and mean square deviation S^2, the squares per reading are
///
///   raw        (y - d)^2 + S^2
///   corrected  (f^-1(y) - d)^2 + S^2 / f'^2,      f from the readings of the other stops; the raw one if f has no
///              root near d.
struct LeftOutErrors {
  /// Per group of stops: sums over its readings of raw and corrected squares, and their number.
  std::vector<double> raw_sq, corrected_sq, readings;
  /// The same, each reading weighted by 1 / (s^2 / W + var d), so that the noise of far readings does not dominate.
  std::vector<double> raw_weighted, corrected_weighted;
  /// Variance of the sum of raw less corrected weighted squares that is the reference's: its errors are common to the groups,
  /// and the curve follows them, since both know the same bearings.
  double reference_variance = 0.0;
};

/// `problem`: without gross outliers, or as the noise shapes weigh the readings (weighted_problem). The squares' weights use the
/// curve and noise of `weighed_by`. Cells whose distance bearings do not determine count in neither sum.
LeftOutErrors left_out_errors(const JointProblem& problem, const ReferenceDistances& reference,
                              const JointState& state, const StopInfluence& influence,
                              const JointState& weighed_by);

/// Readings at known distances d [m], in the order of the recordings.
struct KnownReadings {
  std::span<const double> true_m, reading_m;
  std::span<const double> weight;  ///< robust weights, one per reading
  std::span<const char> judged;    ///< 0: an outlier, whose error says nothing about the curve
  std::span<const int> block;      ///< number of its block (core/blocks.hpp), held out whole, from 0
};

/// The same for pairs, where a group is a block of readings. The curve without a group is that of least squares with the
/// weights w / s^2 of the estimate. `halves`: gets the difference between the curves of the first and the second half of the
/// readings, and its covariance; its groups stay empty.
LeftOutErrors left_out_errors(const KnownReadings& readings, const Calibration& calibration,
                              const Calibration& weighed_by, StopInfluence& halves);

/// By how much squares of held-out groups, one each, are smaller for `simpler` than for `other`, per group, and the standard error of
/// that.
struct Gain {
  double mean = 0.0, std_dev = 0.0;
};
Gain gain_of(const std::vector<double>& simpler, const std::vector<double>& other);
/// The same of the weighted squares; none if they do not judge the same readings.
std::optional<Gain> gain_of(const LeftOutErrors& simpler, const LeftOutErrors& other);
/// True if `simpler` predicts the groups better than `other`, by more than the standard error of the difference.
inline bool predicts_better(const LeftOutErrors& simpler, const LeftOutErrors& other) {
  const std::optional<Gain> gain = gain_of(simpler, other);
  return gain && gain->mean > gain->std_dev;
}

/// The verdict. Usable if the correction reduces the weighted squares by more than chance (one-sided t test over the groups,
/// 2.5 %) and by at least a tenth, and does not increase the unweighted ones. None with fewer than four groups. `what`: the groups are ("stops").
std::optional<LeftOutCheck> left_out_check(const LeftOutErrors& errors, const StopInfluence* influence,
                                           const std::string& what);

/// Standard deviations by stops and by landmarks relative to the model's, of the curve at five distances and of the landmarks' places:
/// those that are furthest above their threshold. `calibration` has the covariances by stops already. None where there are
/// neither, or none of the model.
std::optional<MisfitOfDeviations> misfit_of(const Calibration& calibration, const StopInfluence* by_stops,
                                            const LandmarkInfluence* by_landmarks);

}  // namespace rangecal
