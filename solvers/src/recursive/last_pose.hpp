// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// The pose u of the last stop of a random walk [m, rad], given the readings z made up to there:
///
///   p(z, u | phi; sigma) = p(z | phi; sigma) p(u | z, phi; sigma),
///   u | z, phi ~ N(a + B delta + sum_i delta_i E_i delta / 2, C + sum_i delta_i D_i),   delta = phi - phi_0
///
/// The first factor is l_s, what LandmarkSums hold. The second is all that later stops can learn of the past
/// beside phi: it is the prior of the stop from which they go on, kept at the sigmas of every node of the
/// grid. With H the Hessian of the block's stops and G its coupling to phi: C = (H^-1)_uu, B = -(H^-1 G)_u
/// and what the prior of the block's own first stop adds to B (WalkStart). D = dC/dphi and E = dB/dphi, by
/// differences at one place of the sigmas, let the law turn with the landmarks: no reading tells how the
/// whole is turned, and none may seem to. Third moments of u are left out. Source: the conditional law of a
/// Gaussian chain, as in the Kalman filter; ours.
struct LastPose {
  bool free_position = true, free_heading = true;
  Pose2 exact;                              ///< what is not free
  std::vector<Eigen::VectorXd> mean;        ///< a: x, y where free, then the heading where free
  std::vector<Eigen::MatrixXd> slope;       ///< B
  std::vector<Eigen::MatrixXd> covariance;  ///< C
  std::vector<Eigen::MatrixXd> bend, turn;  ///< D and E, one for each of phi

  int dim() const { return (free_position ? 2 : 0) + (free_heading ? 1 : 0); }
  Pose2 pose(const Eigen::VectorXd& u) const;
  /// The law interpolated by these weights of the nodes: one node, about phi_0 as before.
  LastPose at(const Eigen::VectorXd& weights) const;
  /// A law of one node about phi_0 + delta; delta may hold landmarks that phi_0 does not.
  LastPose moved(const Eigen::VectorXd& delta) const;
  /// B, D and E of further landmarks: 0.
  void grow(Eigen::Index phis);
};

/// The commanded poses of a problem moved as one body so that the first is `first`: the steps stay as they
/// are.
std::vector<Pose2> commanded_from(const JointProblem& problem, const Pose2& first);

/// Where the commanded step to stop k leads from a pose of the stop before.
Pose2 commanded_step(const JointProblem& problem, const Pose2& from, std::size_t k);

/// A problem whose first stop has the law of a LastPose, the mean of which moves with phi.
class WalkStart {
 public:
  /// Changes the prior of the first stop, and the commanded poses with it; all else must outlive this.
  WalkStart(JointProblem& problem, const LastPose& law, const Eigen::VectorXd& reference);

  /// The law at these weights of the nodes and this phi. False where its covariance is none.
  bool set(const Eigen::VectorXd& weights, const Eigen::VectorXd& phi);

  /// After set and settle_stops: what the law that moves along with phi adds to the gradient of l_s,
  ///   -B^T W (u - m) + (tr(W D_i) - (u - m)^T W D_i W (u - m) - tr(C_uu W D_i W)) / 2,
  /// m its mean, W the inverse of its covariance, C_uu = (H^-1)_uu, and to the Schur complement on phi,
  ///   B^T W U + U^T W B + B^T (W - W C_uu W) B - E^T W (u - m),   U = (H^-1 G)_u;
  /// what D adds there is of the size of one reading's share, and left out.
  struct Share {
    Eigen::VectorXd gradient, log_det_gradient;  ///< the latter: the last term alone, which the first lacks
    Eigen::MatrixXd schur;
  };
  Share share(const JointSystem& system, const JointState& state) const;
  /// W B, for the turn of the stops with it: du = H^-1 (., u) W B dphi.
  Eigen::MatrixXd pull() const { return information_ * now_.slope[0]; }

 private:
  JointProblem& problem_;
  std::vector<Pose2> commanded_;
  const LastPose& law_;
  const Eigen::VectorXd& reference_;
  LastPose now_;                 ///< one node, about the phi of set
  Eigen::MatrixXd information_;  ///< W
};

/// After settle_stops: the law of the last stop, one node about the phi of `state`; without D and E.
LastPose law_of_last(const JointSystem& system, const JointState& state, const WalkStart* start);

}  // namespace rangecal
