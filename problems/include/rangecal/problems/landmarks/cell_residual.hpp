// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// f and the noise law as the block that all cells share holds them: u with alpha = origin + basis u, then
/// tau (log sigma of a power law, or beta), then log sigma_theta.
struct CurveBlock {
  CurveBlock(const JointState& reference, Eigen::MatrixXd basis);
  int alpha_count() const { return static_cast<int>(origin.size()); }
  int size() const { return alpha_count() + tau_count + 1; }

  Eigen::VectorXd origin;
  Eigen::MatrixXd basis;
  NoiseLaw law;
  int tau_count;
};

/// Where a stop's unknowns stand in the block of its place (x, y, headings of its stops), as changes from a
/// reference.
struct StopBlock {
  Pose2 reference;
  int size = 0;           ///< of the block; 0: there is none
  bool position = false;  ///< entries 0 and 1 are x and y [m]
  int heading = -1;       ///< entry of its heading [rad], -1 where exact

  Pose2 pose(const double* own) const;
};

/// The readings of one cell as residuals whose half sum of squares is their share of the joint negative
/// log-likelihood up to a constant.
///
/// Measured: R ranges with mean y [m] and mean square deviation S^2 [m^2], R bearings with mean b [rad].
/// Symbols:  p, h position [m] and heading [rad] of the stop, m axis of the landmark [m], D = |m - p| and
///           d = D - radius [m], theta = atan2(m - p) - h [rad], f(d) = sum alpha_i d^i [m],
///           lambda = log s(d) the noise law.
/// Equation: y = f(d) + s e, b = theta + sigma_theta nu, e, nu ~ N(0, 1).
/// Residuals, W and V the weights of the squares of range and bearing (R, or sums of robust weights):
///
///   sqrt(W) (y - f) / s,   sqrt(2 R (lambda - lambda_floor)),   sqrt(V) wrap(b - theta) / sigma_theta,
///   sqrt(2 R (lambda_floor - lambda_reference + margin)), the level,   sqrt(W) S / s where it repeats.
///
/// The log-determinant R lambda stands in the second residual, above a floor, and in the level, which says
/// where the floor is: the sum of squares is that of the likelihood whatever the floor, so it may move
/// between any two evaluations. With lambda_floor = lambda - 1/2 the second residual is sqrt(R), and J^T J
/// has the Fisher information as its expectation: the trust-region solver of a least-squares library then
/// does Fisher scoring. What depends on sigma_theta alone is in BearingSpreadResidual.
/// Source: the joint likelihood (docs/equations.md, "The two likelihoods"); the pair of residuals is our derivation.
///
/// Parameter blocks: the curve's, the stop's (where there is one), the landmark's (x, y) [m]. Few and small:
/// a solver of sparse least squares takes every row as dense over its blocks.
class CellResidual {
 public:
  /// Keeps pointers to `problem` and `curve`. `reference`: the state whose spread the level counts from.
  CellResidual(const JointProblem& problem, const CurveBlock& curve, const JointState& reference,
               StopBlock stop, int cell);

  int residual_count() const { return repeats_ ? 5 : 4; }
  std::vector<int> block_sizes() const;
  int landmark() const { return problem_->cells.landmark[cell_]; }

  /// Residuals, and where not null their Jacobians, row-major, one per block and null where not wanted.
  /// log_floor null: lambda - 1/2 at the blocks given. False outside of the domain (d, f, s positive), below
  /// the floor, and where the level would be the root of a negative number: a spread below e^-margin of the
  /// reference's.
  bool evaluate(const double* const* blocks, const double* log_floor, double* residuals,
                double** jacobians) const;

  /// lambda at the blocks given. False outside of the domain.
  bool log_spread(const double* const* blocks, double& log_spread) const;
  /// Moves lambda_reference to these blocks.
  bool set_reference(const double* const* blocks) { return log_spread(blocks, reference_log_spread_); }

  static constexpr double margin = 3.0;  ///< [nats per reading]

 private:
  struct Curve;

  const JointProblem* problem_;
  const CurveBlock* curve_;
  StopBlock stop_;
  int cell_;
  bool repeats_;
  double reference_log_spread_;
};

/// The share of sigma_theta alone, over all N bearings: sqrt(sum V S_b^2) / sigma_theta,
/// sqrt(2 N (log sigma_theta - log_floor)), and the level as above. One block: log sigma_theta is entry
/// `index` of it.
struct BearingSpreadResidual {
  /// N, sum V S_b^2 [rad^2], log sigma_theta at start.
  double readings = 0.0, square_sum = 0.0, log_reference = 0.0;
  int index = 0, block_size = 0;

  /// Three residuals; log_floor null: anchored at the block given.
  bool evaluate(const double* sigmas, const double* log_floor, double* residuals, double* jacobian) const;
};

/// The prior of one stop that does not continue a random walk: R e, e = (p - p_commanded, wrap(h - h_commanded)),
/// R^T R = C^-1; the rows of the position where it opens its place and is free, that of the heading where it is free. One
/// block: its place's.
struct StopPriorResidual {
  StopPriorResidual(const StopPrior& prior, double sigma_xy_m, const StopBlock& stop);
  int residual_count() const { return (position ? 2 : 0) + (heading ? 1 : 0); }
  void evaluate(const double* own, double* residuals, double* jacobian) const;

  StopBlock stop;
  Pose2 commanded;
  bool position = false, heading = false;
  Eigen::Matrix3d root =
      Eigen::Matrix3d::Zero();  ///< R [1/m, 1/rad]; zero rows where there is no such residual
};

}  // namespace rangecal
