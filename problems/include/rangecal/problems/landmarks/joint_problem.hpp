// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Geometry>
#include <optional>
#include <span>
#include <vector>

#include "rangecal/core/noise.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/landmarks/stop_prior.hpp"

namespace rangecal {

/// Sufficient statistics of the repeats of one (stop, landmark), structure of arrays, ordered by stop. For the
/// Gaussian likelihood a cell of R readings says all that its rows say, so a fit's cost does not grow with R.
/// Readings with covariates that matter, or weights, come as cells of one reading behind the same interface.
struct Cells {
  std::vector<int> stop, landmark;        ///< indices into JointProblem
  std::vector<double> count;              ///< R, the number of readings
  std::vector<double> range_weight;       ///< weight of the squares of range: R, or the sum of robust weights
  std::vector<double> bearing_weight;     ///< the same for bearing
  std::vector<double> range_mean;         ///< weighted mean of y [m]
  std::vector<double> range_mean_square;  ///< S^2: weighted mean square deviation about range_mean [m^2]
  std::vector<double> bearing_mean;       ///< mean bearing, unwrapped about the cell's first reading [rad]
  std::vector<double> bearing_mean_square;  ///< [rad^2]
  std::vector<double> radius_m;             ///< of the cell's landmark
  std::vector<int> stop_begin;  ///< K + 1 entries: cells of stop k are stop_begin[k] .. stop_begin[k+1]-1
  /// Effects that change with distance leave b (d - d_0) on top of f(d): b [-] and d_0 [m]; both empty for none.
  std::vector<double> effect_slope, effect_slope_at_m;

  std::size_t size() const { return stop.size(); }
  /// b (d - d_0) of cell i [m].
  double effect_change(std::size_t i, double d) const {
    return effect_slope.empty() ? 0.0 : effect_slope[i] * (d - effect_slope_at_m[i]);
  }
};

/// The 2021 problem as the estimators see it: one sensor, all recordings of the job laid end to end.
struct JointProblem {
  Cells cells;
  std::vector<StopPrior> stops;
  int place_count = 0;
  std::vector<double> landmark_radius_m;  ///< one per landmark; its size is the number of landmarks
  std::vector<int> landmark_recording;
  std::vector<KnownDistance> known_distances;  ///< over the joint landmark indices
  bool estimate_sigma_s = false;     ///< sigma_xy of the stops without one of their own is a parameter
  std::vector<char> sigma_s_shared;  ///< per stop: it takes part in that parameter
  double readings = 0.0;             ///< N, the sum of the counts
  /// False of ranges alone: the cells' bearings are silent (SilentBearing), and likelihoods are those of ranges, stops and taped
  /// distances.
  bool reads_bearings = true;
  /// Rows: a cell of several readings holds such as are alike within a fraction of their spread, and stands for them.
  bool rows_alike = false;

  int stop_count() const { return static_cast<int>(stops.size()); }
  int landmark_count() const { return static_cast<int>(landmark_radius_m.size()); }
};

/// What the bearing of a cell of ranges alone is, `count` of them: a weight w below any geometry's and a mean square S^2 with
/// w S^2 = count, so that count ln sigma_theta + w (residual^2 + S^2) / (2 sigma_theta^2) is least at sigma_theta = 1 rad, whatever the
/// residual. Powers of two: the product is exact.
struct SilentBearing {
  static constexpr double sigma_theta_rad = 1.0;
  /// What `readings` of them add to an NLL there [nats].
  static double nll(double readings) { return readings * (half_log_two_pi + 0.5); }

  double weight, mean_square;
  explicit SilentBearing(double count) : weight(count * 0x1p-600), mean_square(0x1p600) {}
};

/// How a recording is turned into cells.
enum class Grouping { cells, rows };

/// Lays the recordings end to end and groups their readings. Throws InputError for a recording of kind pairs, for recordings
/// with bearings beside others without, for a place that is revisited under a random walk, for a covariance that no error
/// can have or that ties the heading of a stop that was turned where it stood to a step, and for a place of more stops
/// (about 32 000 with headings of their own) than an int can index the block of. Cost: linear in the readings.
JointProblem make_joint_problem(std::span<const Recording> recordings, Grouping grouping = Grouping::cells);

/// The rows (a problem of Grouping::rows) summed up by cell again, those alone that are `kept` (one flag per row; empty:
/// all); stops and landmarks stay, also where nothing of them is left. `cell_of_row`, where wanted, has the cell of each
/// row, -1 of one left out. Cost: linear in the rows.
JointProblem merge_rows(const JointProblem& rows, const std::vector<char>& kept = {},
                        std::vector<int>* cell_of_row = nullptr);

/// A point in the space of all unknowns of the 2021 problem.
struct JointState {
  Eigen::VectorXd alpha;  ///< f(d) = sum alpha_i d^i
  Noise noise;
  double sigma_theta_rad = 0.02;
  std::optional<double> sigma_s_m;         ///< where it is a parameter: replaces sigma_xy of the shared stops
  std::vector<Pose2> stops;                ///< true poses, one per stop
  std::vector<Eigen::Vector2d> landmarks;  ///< axes [m]
};

/// Mean of the cells' readings, 1 where there are none [m]: the length that what is small or large is told by, so that no
/// answer depends on the unit of length.
double mean_range(const JointProblem& problem);

/// A sigma_s [m] below any resolution of the data, where the stops stand as commanded: 0 itself has no density. A micrometre
/// at readings of 2.5 m.
double no_sigma_s(const JointProblem& problem);

/// What silent bearings add to the NLL of the problem's cells; 0 of a problem with bearings [nats].
double silent_bearing_nll(const JointProblem& problem);

/// sigma_xy of stop k under `state` [m].
double sigma_xy_of(const JointProblem& problem, const JointState& state, int k);

}  // namespace rangecal
