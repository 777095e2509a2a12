// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

namespace rangecal {

struct ClosedFormOptions {
  std::optional<int> order;                        ///< n; absent: chosen by `criterion`
  int max_order = 4;                               ///< highest order tried where it is chosen
  OrderCriterion criterion = OrderCriterion::aic;  ///< over cells, each weighted by its repeats
  BearingOptions bearings;                         ///< weights; sigma_theta and sigma_s where known
  NoiseLaw noise_law = NoiseLaw::f_squared;        ///< law whose parameters are estimated from the residuals
  int max_sweeps = 50;                             ///< of the approximate joint calibration
  double sweep_tolerance = 0.01;  ///< ends when every landmark moves less than this many of its
                                  ///< standard deviations
};

/// The closed-form calibration whole (Alhashimi 2021, eq. 18-28):
///   1. landmarks from bearings at the commanded stops (landmarks_from_bearings);
///   2. distances d = |m_l - s_k| - radius_l [m] of every cell;
///   3. alpha = argmin sum over cells R (y - f(d))^2 (26-28), the order given or chosen;
///   4. the noise from the residuals. The paper leaves beta and sigma_theta of its problem (P1) without a
///      formula; here by moments: the sum of squared residuals of the cell means over their variances
///      s^2 / R + f'^2 (sigma_s^2 + u^T C_l u), plus the squares within the cells over s^2, equals the
///      degrees of freedom N - (n + 1); u the direction to the landmark, C_l its covariance. A polynomial law
///      takes its shape from the regression of sqrt(mean square residual) / c(R), c(1) = sqrt(2 / pi), on
///      powers of d up to order n, lowered until it is positive over the data, and its scale from the same
///      moments. Where the stops alone explain the residuals the noise holds them whole; the reason says so.
///
/// Landmarks that their bearings do not determine are left out (outcome unobservable, the reason names
/// landmark and direction) and have no covariance; their position is then the one from
/// landmarks_from_positions. The covariance of alpha counts noise, stops and landmarks to first order, one error
/// of a stop moving all its cells and landmarks (solvers/src/closed_form/curve_covariance.hpp); not that errors
/// in d bend the curve. Cannot work (too_few_data, alpha empty): fewer than 3 places to stand, distances that do
/// not differ by more than they are uncertain (order >= 1), fewer cells than coefficients + 1. Where bearings
/// determine no landmark at all the outcome is unobservable, alpha and landmarks empty. Else
/// Calibration::landmarks has one entry per landmark of the problem, labels empty. Cost: linear in the cells.
Calibration closed_form_calibration(const JointProblem& problem, const ClosedFormOptions& options = {});

/// The approximate joint calibration: the same alternation with noise d^2 (2016, eq. 21-25, on 2021's
/// distances). One sweep: distances; alpha by least squares with weights R / d^4; noise and sigma_theta by
/// moments; each cell's range inverted to d^ (the root of f(d) = y nearest to the present distance); each
/// landmark by weighted least squares from its lines of sight (variance sigma_s^2 + (sigma_theta^2 / R +
/// sigma_h^2) d^2) and from u . (m_l - s_k) = d^ + radius_l (variance sigma_s^2 + s^2 / (f'^2 R)), u the
/// present direction from stop to landmark: with the measured one in its place wild bearings pull landmarks
/// outwards, sweep by sweep. Positions are extrapolated after every second sweep (SQUAREM), which keeps the
/// fixed point. Ends as not_converged after max_sweeps, as failed where f stops being positive over the data.
/// Starts from the closed form, or from landmarks_from_positions where bearings do not determine one. The
/// covariance of alpha is that of the fixed point, as closed_form_calibration's; those of the landmarks are of the
/// last step, the curve held. Noise law and fields as closed_form_calibration.
Calibration approximate_joint_calibration(const JointProblem& problem, const ClosedFormOptions& options = {});

/// A start for the iterative methods, not an estimate: stops as commanded, landmarks of the closed form (from
/// raw positions where it has none), alpha and noise fitted at them; f(d) = d, sigma 0.02 where even that
/// cannot be. alpha has exactly the order asked for.
JointState closed_form_state(const JointProblem& problem, const ClosedFormOptions& options = {});

/// The same at landmarks given [m], those of landmarks_from_positions for instance.
JointState state_at_landmarks(const JointProblem& problem, const std::vector<Eigen::Vector2d>& landmarks,
                              const ClosedFormOptions& options = {});

/// The closed-form calibration of a recording of kind pairs: alpha by ordinary least squares of y on the
/// known d (2021 eq. 26-28), noise by moments. Throws InputError for kind landmarks. Outcome too_few_data as
/// fit_polynomial.
Calibration closed_form_pairs(const Recording& recording, const ClosedFormOptions& options = {});

/// The approximate ML of a recording of kind pairs (2016 eq. 21-26). Noise: law d_squared with the printed
/// sigma_e; f_squared (the default) with the re-weighted one; other laws by moments.
Calibration approximate_pairs(const Recording& recording, const ClosedFormOptions& options = {});

}  // namespace rangecal
