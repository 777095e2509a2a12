// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "diagnosis/projector.hpp"

namespace rangecal::diagnosis {

/// Residuals in the units that the model expects of them: of a recording, or of one simulated under the
/// model.
struct UnitResiduals {
  Eigen::VectorXd range_rows, bearing_rows;    ///< deviations from the cell means over s: variance 1 - 1/R
  Eigen::VectorXd range_cells, bearing_cells;  ///< cell means over their standard deviations
  Eigen::VectorXd stops;                       ///< estimated shifts of the stops' free coordinates
};

/// One number about residuals, about N(0, 1) where nothing is amiss.
struct ScalarTest {
  std::string channel, covariate, shape;
  double z = 0.0;
  double size = 0.0;  ///< correlation, excess kurtosis, skewness, or relative excess of variance

  std::string name() const { return name_of(channel, shape); }
  /// What its law goes by: "range_tail skew".
  static std::string name_of(const std::string& of_channel, const std::string& of_shape) {
    return of_channel + " " + of_shape;
  }
};

/// Sample skewness m3 / m2^1.5 of n values turned normal (D'Agostino 1970).
double skewness_z(double skewness, double n);

/// The tests of dependence and tails that are no score of a shape:
///   lag 1        sum z_i z_{i-1} within the cells, whose expectation is -(R - 1) / R
///   heavy tails  sample kurtosis, by its own law (statistics/kurtosis_law.hpp); light tails are negative
///   skew         sample skewness
///   spread       squared errors of the stops against their prior, by the cube root
///   lag 1        products of the errors of successive stops
/// Their laws are asymptotic. With few readings the battery centres and scales them by what it simulates.
class ScalarTests {
 public:
  /// `*_dof`: what the calibration leaves of each cell mean's one degree of freedom.
  ScalarTests(const Rows& rows, const Projector& projector, const JointProblem& problem,
              Eigen::VectorXd range_dof, Eigen::VectorXd bearing_dof);

  /// The same tests in the same order for any residuals of this layout.
  std::vector<ScalarTest> of(const UnitResiduals& residuals) const;

 private:
  struct Node {
    int coordinate;
    Eigen::Matrix2d unit;  ///< turns a shift [m] into standard deviations of the prior
    double share;          ///< variance of the estimated shift in these units
  };
  void ask_rows(const std::string& channel, const Eigen::VectorXd& rows, const Eigen::VectorXd& cells,
                const Eigen::VectorXd& dof, std::vector<ScalarTest>& tests) const;
  void ask_stops(const Eigen::VectorXd& shifts, std::vector<ScalarTest>& tests) const;

  const Rows& rows_;
  Eigen::VectorXd range_dof_, bearing_dof_;
  std::vector<Node> nodes_;
};

}  // namespace rangecal::diagnosis
