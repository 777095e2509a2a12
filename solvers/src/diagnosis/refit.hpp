// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/working.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal::diagnosis {

/// A parameter of the model that moves.
struct FreeParameter {
  int effect = 0, index = 0;
  enum class Acts { mean, variance, numeric } acts = Acts::mean;
};

/// 95 % limits of a parameter.
struct Limits {
  double low = 0.0, high = 0.0;
  bool one_sided = false;  ///< the estimate is at its lower bound, `low`
};

/// What the information of the readings was found to lack of the Hessian where all parameters were scored together (damped_scoring.hpp): of
/// alpha, ln sigma, and these parameters of effects.
struct LearnedCurvature {
  Eigen::Index alphas = 0;
  std::vector<std::pair<const Effect*, int>> parameters;
  Eigen::MatrixXd lack;
};

/// A model fitted by marginal ML with all nuisances free.
struct Fit {
  Model model;
  JointState state;
  bool ok = false;
  Outcome outcome = Outcome::failed;                         ///< of the calibration at the fit's parameters
  std::string reason, covariance_reason, weakest_direction;  ///< of it, landmarks by their index
  double nll = 0.0;                                          ///< l_s of the readings themselves [nats]
  std::vector<FreeParameter> free;
  Eigen::MatrixXd covariance;  ///< of the free parameters, calibration marginalised
  /// Of the free parameters, by the profile of the likelihood; none where the covariance gives them, empty
  /// before `add_profile_limits`.
  std::vector<std::optional<Limits>> limits;
  Eigen::MatrixXd alpha_covariance;
  /// Of the landmarks' x, y in order, given the effects' parameters; empty where there is none, and for pairs.
  Eigen::MatrixXd landmark_covariance;
  double sigma_theta_std = 0.0, noise_std = 0.0;
  std::shared_ptr<const LearnedCurvature> learned;  ///< null where nothing was scored
};

/// Newton's decrement at which a calibration beside effects counts as solved, in standard deviations: within 5e-5 nats.
inline constexpr double close_enough = 1e-2;

struct RefitOptions {
  Held held;  ///< alpha and noise of a given simulation
  int max_iterations = 12;
  /// Effects at the front of the model whose dependence, tails and errors of stops stay as they are: line
  /// searches cost most.
  int settled = 0;
  /// Places stay on the side of a switching distance, and in the mode of an oscillating effect, in which the state
  /// has them.
  bool places_stay = false;
  /// Of the calibration's solves: Newton's decrement, in standard deviations; half its square is what is left to gain [nats].
  double gradient_tolerance = 1e-4;
  std::shared_ptr<const LearnedCurvature>
      learned;  ///< of a fit of the same parameters close by; null: of none
};

/// For what is tried around a fit: its dependence, tails and errors of stops stay as they are.
RefitOptions as_they_are(const Fit& fit, RefitOptions options);
/// The same, by a few steps of the other parameters: of many places close by only the best one is fitted to the end.
RefitOptions roughly(const Fit& fit, const RefitOptions& options);

/// Fits `model` from its parameters and `start`: the calibration by marginal ML on the corrected readings,
/// the effects' parameters by damped Gauss-Newton on their projected signatures (variance: Fisher scoring;
/// dependence and tails: line searches on the exact value), in alternation until neither gains.
Fit refit(const Rows& rows, const Model& model, const JointState& start, const RefitOptions& options);

/// Where a fit of `model` starts beside another fit: its state, and where all is scored together the curve moved to take up what the model
/// lacks of the other's effects, as far as it can under that fit's weights: a drift that is over at once is an offset.
JointState start_beside(const Rows& rows, const Fit& fit, const Model& model);
/// Fits `model` from there.
Fit refit_beside(const Rows& rows, const Fit& fit, const Model& model, const RefitOptions& options);

/// NLL of the model at its parameters with the calibration refitted; `state` moves to the fit. `detail`: the calibration, the
/// slopes of REML on entry those to begin with.
double calibrate_under(const Rows& rows, const Model& model, JointState& state, const RefitOptions& options,
                       MarginalFit* detail = nullptr);

}  // namespace rangecal::diagnosis
