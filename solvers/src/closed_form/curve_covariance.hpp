// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "closed_form/range_model.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How much a cell weighs in the equations that a closed form solves.
struct CellWeights {
  double curve = 0.0;   ///< w, of y - f(d) in alpha's
  double across = 0.0;  ///< p, of the landmark's distance from the line of sight [1/m^2]
  double along = 0.0;  ///< q, of its distance along it from f^-1(y) [1/m^2]; 0 where ranges place no landmark
  /// The landmark is placed by y itself, taken for the distance: f' is 1 in its equation, and N_l 0.
  bool raw = false;
};

/// cov(alpha) of a closed form to first order: how its estimating equations, whatever their weights, answer to
/// every independent error. Per cell, of stop k and landmark l: phi = (1, d, .., d^n), f' the slope at d, u
/// and t the unit vectors along and across the line of sight, D the distance to the axis [m]; eps and nu the
/// errors of the mean range (variance s^2 / R) and bearing (sigma_theta^2 / R), e and h those of the stop's
/// position and heading. Then
///   sum w phi (eps - f' u.e - phi^T da - f' u.dm_l)                                      = 0
///   sum p t (t.(dm_l + e) - D (nu - h)) + q u (u.(dm_l + e) - (eps - phi^T da) / f')     = 0   per landmark,
/// so that, with F_l = sum w f' phi u^T, M_l = sum p t t^T + q u u^T, N_l = sum q / f' u phi^T, K = F M^-1 and
/// T = (sum w phi phi^T - K N)^-1,
///   da = T sum (w phi - K u q / f') eps + (K (p t t^T + q u u^T) - w f' phi u^T) e - K t p D (nu - h).
/// The same e moves all cells of a stop, those of its place, and along a random walk those of all later stops.
///
/// `samples` and `weights` belong together. Cost: linear in the cells.
Eigen::MatrixXd curve_covariance(const JointProblem& problem, const std::vector<RangeSample>& samples,
                                 const std::vector<CellWeights>& weights, const RangeModel& model,
                                 double sigma_theta_rad, std::optional<double> sigma_s_m);

}  // namespace rangecal
