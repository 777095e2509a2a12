// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <Eigen/Core>
#include <vector>

#include "diagnosis/rows.hpp"
#include "diagnosis/working_problem.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal::diagnosis {

/// What a cause does to the mean of every reading, per unit of its parameter: cell means of range [m] and
/// bearing [rad], and where it changes within a cell the rows' white deviations from them (empty otherwise).
struct Signature {
  Eigen::VectorXd range, bearing;
  Eigen::VectorXd range_rows, bearing_rows;
  bool moves_stops = false;  ///< of a change of the stops
  double drift = 0.0;        ///< of its score, what follows the errors of the stops
  Eigen::VectorXd follows;   ///< the cells' parts of it; empty: none
  bool turns = false;        ///< turns over within the error of a stop: no expectation is known of its score
  bool within() const { return range_rows.size() > 0; }
  void scale(double factor);
  /// Less `share` of the other; of the rows' deviations only where both have them.
  void take_out(double share, const Signature& other);
  /// It turns, too, where one cell alone moves a score of this information too far to be taken to first
  /// order: beside a kink, or where two of a block's shapes nearly cancel.
  void see_whether_it_turns(double information);
};

/// Projects signatures onto the complement of what the calibration can absorb: alpha and landmarks freely,
/// stops against their prior; alpha against its own where a simulation gives one, not at all where it is
/// exact. With W the readings' information, J the derivatives and K = J^T W J + prior,
///   P x = W (x - J K^-1 J^T W x),   score s = x^T W r at the optimum,   information I = x^T P x.
/// s / I estimates the parameter, s^2 / I is its chi-square. W is diagonal, but for ranges whose errors depend on one another
/// along a sequence (SerialErrors): W = D K^T K D, D the reciprocal standard deviations. Cost per signature: linear in the
/// cells and stops.
class Projector {
 public:
  /// `working`: of the same cells as `rows`.
  Projector(const Rows& rows, const WorkingProblem& working, const JointState& state);

  /// P x over the cells, as one vector (range, bearing), the calibration's share removed.
  Eigen::VectorXd project(const Signature& x) const;
  /// x^T P y given P y (and the rows' deviations of both).
  double inner(const Signature& x, const Eigen::VectorXd& projected_y, const Signature& y) const;
  /// x^T W r for the residuals of the working problem at `state`, less its expectation. Where that is not
  /// known none is taken off, nor off the calibration's own scores, of which x may be made up nearly whole.
  double score(const Signature& x) const;
  /// x^T W x: the information before projection.
  double raw_information(const Signature& x) const;
  /// x^T V^-1 x, V the covariance of the readings where alpha and landmarks are known and the stops as well as they are stated: how
  /// precisely a change of the stops could be seen at best.
  double beside_stops(const Signature& x) const;
  /// What alpha and landmarks leave of x^T W x where the stops are known.
  double beside_known_stops(const Signature& x) const;
  /// The information that the calibration has to leave of x, or it absorbs x: 1e-5 of all that x does to the readings. Of a change of
  /// the stops the estimated stops may take up more, for it is seen as well as they are stated; of that alpha and landmarks have to leave
  /// 1e-4, beside known stops (else nothing is enough) and beside stated ones. A change of the stops is linear in them but for some
  /// (sigma_s / distance)^2 = 1e-5 to 1e-4, and what is left of less (of a path longer by one factor, say) is not the change's.
  double least_information(const Signature& x) const;
  /// x^T W y before projection.
  double raw_inner(const Signature& x, const Signature& y) const;
  /// W x of the ranges of the cells, and its inverse: of a projected signature what is left of the readings' change [m].
  Eigen::VectorXd weighted(const Eigen::VectorXd& range) const;
  Eigen::VectorXd unweighted(const Eigen::VectorXd& range) const;
  /// Errors of the ranges of the cells [m] as independent ones of variance 1, W^(1/2) x, and back.
  Eigen::VectorXd whitened(const Eigen::VectorXd& range) const;
  Eigen::VectorXd coloured(const Eigen::VectorXd& white) const;
  /// Slope of the means' NLL in alpha at the state, the stops at their optimum.
  const Eigen::VectorXd& alpha_gradient() const { return alpha_gradient_; }
  /// The change of (alpha, landmarks) that absorbs x: K^-1 J^T W x, and of the stops.
  void absorbed(const Signature& x, Eigen::VectorXd& phi, Eigen::VectorXd& stops) const;
  /// The readings' change when (alpha, landmarks) and the stop coordinates change.
  Signature of_calibration(const Eigen::VectorXd& phi, const Eigen::VectorXd& stops) const;
  /// The signature of changes of every row.
  Signature of_rows(const Eigen::VectorXd& range, const Eigen::VectorXd& bearing) const;
  /// The readings' change when stops move by (dx, dy, dh) each.
  Signature of_stops(const std::vector<Eigen::Vector3d>& moved) const;

  int cells() const { return static_cast<int>(range_information.size()); }
  const CellGeometry& geometry() const { return geometry_; }
  const JointSystem& system() const { return system_; }
  /// Inverse information of (alpha, landmarks), alpha's prior included, over all globals; zero for the
  /// others.
  const Eigen::MatrixXd& phi_covariance() const { return phi_factor_; }
  /// 1/2 ln of its determinant, over the directions that the recording determines.
  double log_phi_volume() const { return log_phi_volume_; }

  /// Cells moved a little, each by what the errors of its range (or its bearing) do to it through the stop;
  /// null where all stops are exact.
  const CellGeometry* moved(bool by_bearing) const { return moved_.empty() ? nullptr : &moved_[by_bearing]; }
  /// What follows the stops in the score of x, which changes by `range` and `bearing` where cells are moved
  /// by theirs. None where x turns over within the error of a stop: its slope averages out, and would be
  /// noise.
  void set_drift(const Eigen::VectorXd& range, const Eigen::VectorXd& bearing, Signature& x) const;

  /// Where the stops are estimated, less where the model means them to be: (dx, dy, dh).
  const std::vector<Eigen::Vector3d>& stop_errors() const { return stop_errors_; }

  Eigen::VectorXd range_residual, bearing_residual;                ///< of the cell means [m], [rad]
  Eigen::VectorXd range_information, bearing_information;          ///< W of the cell means
  Eigen::VectorXd row_range_information, row_bearing_information;  ///< of the white deviations
  Eigen::VectorXd row_range_residual, row_bearing_residual;        ///< white deviations from the cell means

 private:
  struct Pulls {
    Eigen::VectorXd globals, stops;  ///< J^T W x
  };
  Pulls pulls(const Signature& x) const;
  Eigen::MatrixXd serial_information() const;
  Eigen::MatrixXd information_beside_known_stops() const;
  Eigen::VectorXd expect_scores();

  const Rows& rows_;
  CellGeometry geometry_;
  Whitening range_whitening_, bearing_whitening_;
  SerialErrors serial_;
  Eigen::VectorXd slope_;   ///< of the mean range in d, the effects' own included
  Eigen::MatrixXd powers_;  ///< of pairs: the ranges' derivatives in alpha
  JointProblem problem_;    ///< with its spreads held
  JointSystem system_;
  bool only_alpha_;  ///< nothing but alpha can absorb anything: pairs of exact distances
  Eigen::VectorXd alpha_gradient_;
  Eigen::MatrixXd phi_factor_;                       ///< inverse of the Schur complement on phi
  Eigen::LDLT<Eigen::MatrixXd> beside_known_stops_;  ///< of the information of (alpha, landmarks) there
  double log_phi_volume_ = 0.0;
  std::vector<Eigen::Vector3d> stop_errors_;
  Signature expected_;                           ///< m: the residuals that are expected
  Eigen::VectorXd plain_range_, plain_bearing_;  ///< residuals at the optimum of F itself, no expectation off
  Eigen::VectorXd weighted_residual_;            ///< W r of the ranges, where they depend on one another
  std::vector<CellGeometry> moved_;
  double step_ = 1.0;
  std::vector<Eigen::Vector2d> curving_;  ///< sum over cells of W H C J^T, by stop
};

}  // namespace rangecal::diagnosis
