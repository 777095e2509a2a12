// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>

#include "diagnosis/rows.hpp"
#include "diagnosis/whitening.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal::diagnosis {

/// The seed model's problem on readings from which the model's effects were taken: corrected cell means,
/// weights for changed variances and dependence, moved stops; `constant` completes its NLL to that of the
/// readings themselves.
struct WorkingCells {
  JointProblem problem;
  double constant = 0.0;
  Stages stages;        ///< of the model's effects
  SerialErrors serial;  ///< of readings in a sequence: how their errors, as weighted, depend on one another
};

/// The same with the rows that it was made of.
struct WorkingProblem : WorkingCells {
  /// Corrected readings per row; bearings relative to the cell's predicted one.
  Eigen::VectorXd range, bearing;
  /// What a tail's law, given its residual, expects a row's extra error to be [m], which `range` is less, and its variance
  /// in units of the spread's square, of a prediction's along a sequence; empty without tails.
  Eigen::VectorXd tail_shift, tail_square;
  /// What rounding adds to the variance of the range of a row that is alone in its cell, as a part of that variance without its tails;
  /// empty without a grid.
  Eigen::VectorXd rounding_share;
  /// What effects add to ln s^2 of the range of a row that has a tail; empty without tails.
  Eigen::VectorXd range_log_variance;
  /// What is taken off a row's error before the law of its tail applies [m]: the likeliest error that its cell shares, or along a
  /// sequence what the readings before it predict; empty: nothing.
  Eigen::VectorXd tail_centre;
  /// Along a sequence, beside tails: what the standard deviation of the prediction's error is without them, over the spread;
  /// empty: 1.
  Eigen::VectorXd prediction_spread;
  /// `range` of a row with what a tail added to it [m].
  double range_with_tail(Eigen::Index row) const {
    return tail_shift.size() > 0 ? range[row] + tail_shift[row] : range[row];
  }
  /// That less the centre [m], whose error the law of the tail is of.
  double range_of_tail(Eigen::Index row) const {
    return range_with_tail(row) - (tail_centre.size() > 0 ? tail_centre[row] : 0.0);
  }
  /// The spread of a row without its tails, over the calibration's.
  double spread_factor(Eigen::Index row) const {
    return range_log_variance.size() > 0 ? std::exp(0.5 * range_log_variance[row]) : 1.0;
  }
  /// That of the error whose law the tail is of.
  double tail_spread_factor(Eigen::Index row) const {
    return spread_factor(row) * (prediction_spread.size() > 0 ? prediction_spread[row] : 1.0);
  }
  Whitening range_whitening, bearing_whitening;
  Eigen::VectorXd range_deviation, bearing_deviation;  ///< white, from the cell means [m], [rad]
};

}  // namespace rangecal::diagnosis
