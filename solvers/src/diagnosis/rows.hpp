// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "diagnosis/serial_errors.hpp"
#include "rangecal/core/curve_scale.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal::diagnosis {

/// What a simulation says of alpha beforehand: N(mean, precision^-1), or exactly its mean.
struct AlphaPrior {
  Eigen::VectorXd mean;
  Eigen::MatrixXd precision;  ///< empty: exact
  bool exact() const { return precision.size() == 0; }
};

/// What the seed model's curve is a polynomial in, of landmarks always the distance, and of which order where the distances
/// determine it.
struct SeedCurve {
  CurveScale scale;
  int order = 2;
};

/// The readings of a job, one entry per row, ordered by cell and, within a cell, by time.
///
/// Pairs are laid out as the joint problem too. Their cells are the readings of one batch and group at one distance, landmark
/// and bearing (without batches: of one distance ...), which may share an error as repeats from one stop do. Where nearly all
/// stand alone there are no repeats to speak of: every reading is a cell, and they follow one another. Every cell has a
/// stop of its own on a line through one held landmark, at the scale's u of the known distance: the joint problem's
/// "distance", of which the curve is a polynomial. The stop is exact, or as uncertain as the recording's reference. The bearing channel is switched off by a constant residual.
struct Rows {
  std::vector<int> cell, stop, landmark, repeat, file_row;
  std::vector<double> range_m, bearing_rad, time_s, radius_m, heading_rad;
  std::vector<int> block;          ///< what is held out with the row (core/blocks.hpp), from 0
  std::string blocks;              ///< that in words
  std::vector<double> rate_mps;    ///< of the true distance of pairs; of landmarks empty
  std::vector<double> covariates;  ///< row-major, by context.covariates
  Sequence sequence;               ///< of readings without repeats that follow one another; else empty
  int cell_count = 0;
  std::vector<int> cell_begin;  ///< rows of cell c: cell_begin[c] .. cell_begin[c+1]-1

  EffectContext context;
  JointProblem problem;  ///< the seed model's: cells in the same order as `cell`
  bool pairs = false;
  bool reads_bearings() const { return !pairs && problem.reads_bearings; }
  SeedCurve curve;
  double range_min_m = 0.0;                                      ///< of the sensor, as stated
  double range_max_m = std::numeric_limits<double>::infinity();  ///< the same
  std::optional<AlphaPrior> alpha_prior;                         ///< none: alpha is free
  double nll_offset = 0.0;  ///< to be added to NLLs of `problem`: removes the silent bearings of pairs

  std::size_t size() const { return range_m.size(); }
};

/// Throws InputError for no recording, kinds mixed, and landmarks on another scale than the distance.
Rows make_rows(std::span<const Recording> recordings, const SeedCurve& curve = {});

/// Where each row stands in its recording: readings ordered by stop and landmark, pairs by cell in the order in which the
/// file opens them.
std::vector<std::size_t> row_order(const Recording& recording);

/// What effects of one stage do to those of the next, per cell; empty where nothing depends on it.
struct Stages {
  std::vector<double> before_light,
      before_spot;  ///< what earlier ones add to the range, as effects see it [m]
  std::vector<double> path_gain,
      light_gain;  ///< change of the reading per change of the range by an effect there
  /// That of an effect of this stage.
  double gain(Stage stage, int cell) const {
    if (path_gain.empty() || stage > Stage::light) return 1.0;
    return (stage == Stage::path ? path_gain : light_gain)[static_cast<std::size_t>(cell)];
  }
};

/// Geometry and model of every cell under a state.
struct CellGeometry {
  std::vector<double> d, axis_distance, bearing, f, slope, curvature, spread;  ///< slopes in d
  std::vector<double> u;                                                       ///< of d on the curve's scale
  int spread_power = 0;                                                        ///< of the noise law in f
  double sigma_theta_rad = 0.0;                                                ///< of every bearing
  std::vector<Eigen::Vector2d> n, t;  ///< unit vector stop -> landmark, and across (world frame)
  Stages stages;                      ///< of the model's effects, where they were asked for
};
CellGeometry cell_geometry(const Rows& rows, const JointState& state);

/// The view of row i that effects get.
ReadingView<double> view_of(const Rows& rows, const CellGeometry& geometry, std::size_t i);
/// Turns the view of a row into that of another row of its cell.
void see_row(const Rows& rows, std::size_t i, ReadingView<double>& view);

/// Half the width [m] of a central difference in distance: a millionth of d. The phase k / d of pixel locking
/// turns by k / d^2 per metre, its period is 2 pi d^2 / k: 0.1 mm at 0.2 m for k = 2000 m, of which this is a
/// six-hundredth. Rounding, 1e-16 of a change over this step, is 1e-10 of it per metre.
double distance_step(double d);

/// The same view from h [m] farther away.
inline ReadingView<double> moved_by(ReadingView<double> view, double h) {
  view.d += h;
  view.axis_distance += h;
  view.f += h * view.slope;
  return view;
}

}  // namespace rangecal::diagnosis
