// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include <Eigen/Core>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// All readings of one place, and the prior on its stops, as residuals whose half sum of squares is their share of the
/// joint negative log-likelihood up to a constant.
///
/// Measured: per cell R ranges with mean y [m] and mean square deviation S^2 [m^2], R bearings with mean b [rad].
/// Symbols:  p, h position [m] and heading [rad] of the stop, m axis of the landmark [m], D = |m - p|, d = D - radius
///           [m], theta = atan2(m - p) - h [rad], f(d) = sum alpha_i d^i [m], lambda = log s(d) the noise law.
/// Equation: y = f(d) + s e, b = theta + sigma_theta nu, p = p_commanded + sigma_s (e_x, e_y), e, nu ~ N(0, 1).
/// Residuals, W and V the weights of the squares of range and bearing (R, or sums of robust weights):
///
///   sqrt(W) (y - f) / s,   sqrt(2 R (lambda - lambda_floor)),   sqrt(V) wrap(b - theta) / sigma_theta,
///   sqrt(W) S / s (where anything repeats);   (p - p_commanded) / sigma_s,   wrap(h - h_commanded) / sigma_h;
///   sqrt(2 sum R (lambda_floor - lambda_reference + margin)), the level.
///
/// The log-determinant sum R lambda stands in the second residual, above a floor, and in the level, which says where the
/// floors are: the sum of squares is that of the likelihood whatever the floors, so they may move between any two
/// evaluations. With lambda_floor = lambda - 1/2 the second residual is sqrt(R), and J^T J has the Fisher information
/// as its expectation: the trust-region solver of a least-squares library then does Fisher scoring.
/// What of the bearings' likelihood depends on sigma_theta alone is in BearingSpreadResidual.
/// Source: the joint likelihood (docs/equations.md); the pair of residuals is our derivation.
///
/// Parameter blocks: u (alpha = origin + basis u), sigmas (tau, log sigma_theta), then, where there are any, the
/// coordinates of the place (x, y, headings of its stops in order, each as a change from the reference), then one block
/// (x, y) [m] per landmark seen, in the order of landmarks().
class StopResidual {
 public:
  /// `stops`: of one place, in order. `reference`: the state from which changes count. Keeps a pointer to `problem`.
  StopResidual(const JointProblem& problem, const JointState& reference, const Eigen::MatrixXd& basis,
               std::vector<int> stops);

  const std::vector<int>& landmarks() const { return landmarks_; }
  std::vector<int> block_sizes() const;
  int residual_count() const { return residuals_; }
  int coordinates() const { return coordinates_; }
  int cell_count() const { return static_cast<int>(reference_log_spread_.size()); }

  /// Residuals, and where not null their Jacobians, row-major, one per block and null where not wanted.
  /// log_floor: one per cell, in order of stops and cells; null: lambda - 1/2 at the blocks given.
  /// False outside of the domain (d, f, s positive), below a floor, and where the level would be the root of a
  /// negative number: spreads below e^-margin of the reference on average.
  bool evaluate(const double* const* blocks, const double* log_floor, double* residuals, double** jacobians) const;

  /// lambda of every cell at the blocks given. False outside of the domain.
  bool log_spreads(const double* const* blocks, double* log_spread) const;
  /// Moves lambda_reference to these blocks.
  bool set_reference(const double* const* blocks);

  static constexpr double margin = 3.0;  ///< [nats per reading]

 private:
  struct Curve;
  Curve unpack(const double* const* blocks) const;

  const JointProblem* problem_;
  Eigen::VectorXd alpha_;
  Eigen::MatrixXd basis_;
  NoiseLaw law_;
  int tau_count_, power_of_f_;
  std::vector<int> stops_, landmarks_, slot_of_cell_;
  std::vector<Pose2> reference_stops_;
  std::vector<int> heading_;                  ///< per stop: its coordinate, or -1 where exact
  std::vector<double> sigma_xy_;              ///< per stop; 0: no prior row
  std::vector<double> reference_log_spread_;
  bool free_position_ = false, repeats_ = false;
  int coordinates_ = 0, residuals_ = 0;
};

/// The share of sigma_theta alone, over all N bearings: sqrt(sum V S_b^2) / sigma_theta,
/// sqrt(2 N (log sigma_theta - log_floor)), and the level as above. One block: log sigma_theta is entry `index` of it.
struct BearingSpreadResidual {
  double readings = 0.0, square_sum = 0.0, log_reference = 0.0;  ///< N, sum V S_b^2 [rad^2], log sigma_theta at start
  int index = 0, block_size = 0;

  /// Three residuals; log_floor null: anchored at the block given.
  bool evaluate(const double* sigmas, const double* log_floor, double* residuals, double* jacobian) const;
};

}  // namespace rangecal
