// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// How a cell's line of sight is weighted. R: its repeats; d: measured distance to the axis; var(d~): variance of its mean range.
enum class BearingWeights {
  paper,      ///< 1 / var(d~)                                   (2021 eq. 20, 22)
  printed,    ///< sigma_s^2 + sigma_theta^2 / var(d~)           (eq. 25 as printed: mixes a variance with a
              ///< weight)
  consistent  ///< 1 / (sigma_s^2 + (sigma_theta^2 / R + sigma_h^2) d^2)   (the variance of residual 24, as a
              ///< weight)
};

/// "paper", "printed", "consistent".
const char* to_string(BearingWeights weights);
/// The inverse of to_string; throws InputError for another text.
BearingWeights bearing_weights_from_string(const std::string& text);

struct BearingOptions {
  BearingWeights weights = BearingWeights::consistent;
  std::optional<double> sigma_theta_rad;  ///< of one bearing; absent: from the residuals, see below
  std::optional<double> sigma_s_m;        ///< replaces sigma_xy of every stop; absent: each stop's own
};

struct LandmarkFromBearings {
  Outcome outcome = Outcome::failed;                     ///< converged; unobservable; too_few_data
  std::string reason;                                    ///< names the direction that is not determined
  int cells = 0;                                         ///< lines of sight
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero();  ///< only where converged
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();  ///< [m^2], under the variance of residual (24)
  double condition = 0.0;  ///< sqrt of the ratio of the eigenvalues of H^T W H; infinite if parallel
  Eigen::Vector2d weakest_direction = Eigen::Vector2d::Zero();  ///< unit vector
};

struct LandmarksFromBearings {
  Outcome outcome = Outcome::
      failed;  ///< converged: all landmarks; unobservable: one or more are not determined; too_few_data: no cells
  std::string reason;
  std::vector<LandmarkFromBearings> landmarks;  ///< one per landmark of the problem
  double sigma_theta_rad = 0.0;                 ///< used in the weights and covariances
  bool sigma_theta_estimated = false;
  std::vector<double> cell_weights;  ///< W of the cells; only ratios within one landmark matter
};

/// Landmark axes from bearings seen from the commanded stops (2021 eq. 18-25). With the world direction
/// phi = commanded heading + mean bearing of the cell [rad] and the commanded stop (x, y) [m], each cell
/// gives a line
///   sin phi (x_l - x) - cos phi (y_l - y) = residual [m],   m_l = (H^T W H)^-1 H^T W b,
/// rows of H (sin phi, -cos phi), b = sin phi x - cos phi y. The residual's variance is
/// sigma_s^2 + (sigma_theta^2 / R + sigma_h^2) d^2 (24, derived; the paper has var(d~) for d^2).
///
/// Under a random walk the stop's covariance is that accumulated up to it (closed_form/stop_variance.hpp); errors that stops share are
/// treated as independent. The test for parallel lines takes that of one step: a shared error turns all lines alike.
///
/// var(d~), needed by `paper` and `printed`: of the mean of the cell, from its repeats (R >= 2); elsewhere
/// c d^4 / R with c the mean of var / d^4 over the cells that have repeats, c = 1e-4 m^-2 where none has (for
/// `paper` only ratios matter).
///
/// Where sigma_theta is not given it starts at the spread within the cells, or 0.02 rad where nothing
/// repeats, and is estimated twice from the residuals (moments, degrees of freedom corrected, sigma_s
/// accounted for); once where the first estimate leaves no landmark.
///
/// A landmark is unobservable when its lines are parallel: seen from one place, in line with the path, or so
/// nearly that the spread of the lines' directions is below 1.5 times what sigma_theta, sigma_s and sigma_h alone
/// would make of parallel lines; its reason names the direction along the lines. If the directions do differ by more than the noise of the
/// repeats explains, and only the enlarged sigma_theta hides that, the reason says that the lines do not meet: a path that drifted, or
/// bearings mixed up. Cost: linear in the cells.
LandmarksFromBearings landmarks_from_bearings(const JointProblem& problem,
                                              const BearingOptions& options = {});

/// The mean of stop + (y + radius) (cos phi, sin phi) over the cells of each landmark, weighted by their
/// readings: takes the raw range for true, so it is biased, but it stands where lines of sight are parallel.
/// Absent for a landmark without cells. Cost: linear in the cells.
std::vector<std::optional<Eigen::Vector2d>> landmarks_from_positions(const JointProblem& problem);

}  // namespace rangecal
