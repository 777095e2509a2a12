// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "recursive/last_pose.hpp"

namespace rangecal {

/// Chebyshev nodes over the logarithms of sigma_e and sigma_theta, `side` each way, about a centre.
struct SigmaGrid {
  static constexpr int side = 6, nodes = side * side;
  Eigen::Vector2d centre = Eigen::Vector2d::Zero();  ///< (log sigma_e, log sigma_theta)
  double half_width = 0.4;

  Eigen::Vector2d node(int q) const;
  /// Lagrange's polynomials of all nodes at a place.
  Eigen::VectorXd weights(const Eigen::Vector2d& log_sigmas) const;
};

/// What stops say about phi = (alpha, landmarks) and the sigmas once their own poses are integrated out: l_s,
/// the marginal NLL of those stops by Laplace's method [nats], of third order in phi about an expansion point
/// and interpolated over the sigmas,
///
///   l_s(phi; sigma) = sum_q L_q(sigma) (c_q + g_q^T delta + delta^T H_q delta / 2) + T(delta, delta, delta)
///   / 6, delta = phi - phi_0,
///
/// L_q the Lagrange polynomials of the grid's nodes. A sigma enters the likelihood of N readings by factors
/// e^(-2 log sigma), which six nodes over +- 0.4 give to 1e-5; over the distance of a standard deviation the
/// likelihood is a quadratic in phi but for a percent, which the third order takes in. Stops of independent
/// errors add up, whatever their expansion points: all are told about the same phi_0. So do the blocks of a
/// random walk, each given the readings before it: what ties it to them is last_pose.
struct LandmarkSums {
  SigmaGrid grid;
  Eigen::VectorXd reference;              ///< phi_0
  Eigen::VectorXd value;                  ///< c_q
  std::vector<Eigen::VectorXd> gradient;  ///< g_q
  std::vector<Eigen::MatrixXd> hessian;   ///< H_q
  /// T by its first index; empty above `most_cubed` unknowns, since it takes their cube of memory.
  std::vector<Eigen::MatrixXd> third;
  static constexpr Eigen::Index most_cubed = 64;
  Eigen::MatrixXd
      beyond;  ///< what 1/2 log det H_ss has in every H_q; REML's A is H_q without it, as in solve_marginal
  std::optional<LastPose> last_pose;  ///< of a random walk: where it has come to

  /// Landmarks that were not there before begin at these values of phi, without information.
  void grow(const Eigen::VectorXd& whole_reference);
  void add(const LandmarkSums& other);  ///< of the same grid and phi_0, and of the stops that follow
  void scale(double factor);            ///< of what was said of phi; where the walk has come to stays known
  /// Moves the grid to where the sigmas are, once they have left its middle; extrapolates by half its width
  /// at most.
  void follow(const Eigen::Vector2d& log_sigmas);

  struct At {
    double value = 0.0;
    Eigen::VectorXd gradient;
    Eigen::MatrixXd hessian;
  };
  At at(const Eigen::Vector2d& log_sigmas) const;
};

/// The sums of all stops of `problem` (power law of the noise) expanded at `state`, whose stops move to their
/// optimum. None where they have none at one of the nodes. `first`: the law of the first stop, where that
/// goes on from a random walk summed up before. Cost: some 100 assemblies of the problem.
std::optional<LandmarkSums> expand_stops(const JointProblem& problem, JointState& state,
                                         const SigmaGrid& grid, const Eigen::VectorXd& reference,
                                         const LastPose* first = nullptr);

/// Where the sums are lowest as `marginal` has it: phi at its best for the sigmas, the sigmas by REML.
struct SumsFit {
  bool ok = false, at_edge = false;  ///< at_edge: a sigma is held at the end of the grid
  /// A step of Newton's for the sigmas would be below 1e-7, or gain less than 1e-6 nats or the rounding of the sums.
  /// False where the steps ran out, or none was found, before.
  bool settled = false;
  /// By that step [nats]: g^2 / (2 lambda) along each eigenvector of the profile's Hessian, g the slope along it and
  /// lambda its eigenvalue; at most |g| w, w the width of the grid; |g| w + |lambda| w^2 / 2 where lambda < 0.
  double to_gain = 0.0;
  Eigen::VectorXd phi;
  Eigen::Vector2d log_sigmas;
  double nll = 0.0;         ///< l_s [nats]
  Eigen::MatrixXd hessian;  ///< of l_s in (phi, log sigmas), held coefficients left in place
};

/// With alpha of `alphas` coefficients, those from `order` + 1 on held at 0.
SumsFit minimise_sums(const LandmarkSums& sums, int alphas, int order, const Eigen::Vector2d& start);

/// The Hessian of l_s in (phi, log sigmas) [nats per unit squared] at delta = phi - phi_0, without what 1/2 log det H_ss
/// has in it: the information of what was summed up.
Eigen::MatrixXd information_at(const LandmarkSums& sums, const Eigen::VectorXd& delta,
                               const Eigen::Vector2d& log_sigmas);

/// sum_i delta_i T_i, the third derivatives along one direction; 0 where none are kept.
Eigen::MatrixXd along(const std::vector<Eigen::MatrixXd>& third, const Eigen::VectorXd& delta);

/// (alpha, landmarks) of a state.
Eigen::VectorXd phi_of(const JointState& state);
/// (log sigma_e, log sigma_theta) of a state.
Eigen::Vector2d log_sigmas_of(const JointState& state);

}  // namespace rangecal
