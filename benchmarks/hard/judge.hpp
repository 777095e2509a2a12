// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <chrono>
#include <cmath>
#include <limits>
#include <optional>
#include <string>
#include <vector>

#include "hard/worlds.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "rangecal/solvers/nlopt/joint_check.hpp"

namespace rangecal::hard {

/// What one method made of one world, and what an outsider finds about it.
struct Judgement {
  Method method = Method::full;
  std::string outcome;  ///< as in Outcome, or "refused" where the input was
  std::string reason;
  std::string violation;  ///< empty: the answer is what it says
  double nll = 0.0;       ///< joint for `full`, l_s for `marginal`, at its answer [nats]
  double seed_nll = 0.0;  ///< the same at the seed; NaN where there is none
  double gradient = 0.0;  ///< sqrt(g^T H^-1 g) at the answer, its distance from the optimum in standard
                          ///< deviations; H Fisher's information where the Hessian is not positive definite
  double better_nll = std::numeric_limits<double>::quiet_NaN();  ///< NLopt's, where it was asked
  int iterations = 0;
  double seconds = 0.0;
};

/// A converged answer may be this many standard deviations away from where the gradient vanishes.
inline constexpr double gradient_bar = 0.05;

inline double scaled_norm(const Eigen::VectorXd& gradient, const Eigen::MatrixXd& information) {
  Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
  const Eigen::LDLT<Eigen::MatrixXd> factor(scale.asDiagonal() * information * scale.asDiagonal());
  const Eigen::VectorXd g = scale.cwiseProduct(gradient);
  return std::sqrt(std::max(0.0, g.dot(factor.solve(g))));
}

inline std::optional<JointState> state_of(const JointProblem& problem, const Calibration& c) {
  if (c.alpha.size() == 0 || !c.sigma_theta_rad || c.stops.size() != problem.stops.size() ||
      static_cast<int>(c.landmarks.size()) != problem.landmark_count())
    return std::nullopt;
  JointState state;
  state.alpha = c.alpha;
  state.noise = c.noise;
  state.sigma_theta_rad = c.sigma_theta_rad->value;
  if (c.sigma_s_m) state.sigma_s_m = std::max(c.sigma_s_m->value, no_sigma_s(problem));
  for (const StopEstimate& stop : c.stops) state.stops.push_back(stop.pose);
  for (const LandmarkEstimate& landmark : c.landmarks) state.landmarks.push_back(landmark.position_m);
  return state;
}

inline bool all_finite(const Calibration& c) {
  bool finite = c.alpha.allFinite() && c.noise.parameters.allFinite();
  if (c.alpha_covariance)
    finite =
        finite && c.alpha_covariance->allFinite() && (c.alpha_covariance->diagonal().array() >= 0.0).all();
  const auto check = [&](const Estimate& e) {
    finite = finite && std::isfinite(e.value) && (!e.std_dev || std::isfinite(*e.std_dev));
  };
  for (const Estimate& e : c.noise_estimates) check(e);
  if (c.sigma_theta_rad) check(*c.sigma_theta_rad);
  if (c.sigma_s_m) check(*c.sigma_s_m);
  for (const LandmarkEstimate& l : c.landmarks)
    finite = finite && l.position_m.allFinite() && (!l.covariance || l.covariance->allFinite());
  for (const StopEstimate& s : c.stops)
    finite = finite && std::isfinite(s.pose.x_m + s.pose.y_m + s.pose.heading_rad);
  return finite;
}

/// The lower of the two seeds that a calibration starts from; none where neither lies inside the domain.
inline std::optional<JointState> seed_of(const JointProblem& problem, int order, NoiseLaw law) {
  std::optional<JointState> best;
  double lowest = std::numeric_limits<double>::infinity();
  for (bool closed : {true, false}) try {
      ClosedFormOptions options;
      options.order = order;
      options.noise_law = law;
      if (problem.estimate_sigma_s) options.bearings.sigma_s_m = 0.01;
      JointState state = closed ? closed_form_state(problem, options) : position_seed(problem, order, law);
      if (problem.estimate_sigma_s) state.sigma_s_m = 0.01;
      const double nll = joint_nll(problem, state);
      if (nll < lowest) {
        lowest = nll;
        best = state;
      }
    } catch (const InputError&) {
    }
  return best;
}

/// What `marginal` minimises over alpha and landmarks, l_s, and over the sigmas, l_s + 1/2 log det A; and how
/// steep l_s is.
struct MarginalAt {
  double value = std::numeric_limits<double>::infinity(), criterion = value, gradient = value;
};
inline MarginalAt marginal_at(const JointProblem& problem, const JointState& state) {
  MarginalAt at;
  const LaplaceValue laplace = laplace_marginal(problem, state);
  if (!laplace.ok) return at;
  JointSystem system(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()));
  system.assemble(laplace.state, HessianKind::exact);
  if (!system.eliminate()) return at;
  const int n = system.layout().phi_count;
  const Eigen::MatrixXd A = system.schur().topLeftCorner(n, n);
  const Eigen::LLT<Eigen::MatrixXd> factor(A);
  at.value = at.criterion = laplace.marginal_nll;
  if (factor.info() == Eigen::Success) at.criterion += factor.matrixLLT().diagonal().array().log().sum();
  at.gradient = scaled_norm((system.reduced_gradient() + system.log_det_gradient(laplace.state)).head(n), A);
  return at;
}

inline void judge_full(const JointProblem& problem, const std::optional<JointState>& seed,
                       const Calibration& c, bool ask_nlopt, Judgement& j) {
  const JointState state = *state_of(problem, c);
  JointSystem system(problem, static_cast<int>(c.alpha.size()), static_cast<int>(c.noise.parameters.size()));
  j.nll = system.assemble(state, HessianKind::fisher);
  Eigen::VectorXd gradient(system.layout().global_count + system.layout().coordinates);
  gradient << system.global_gradient(), system.stop_gradient();
  const Eigen::MatrixXd information = system.dense_hessian();
  system.assemble(state, HessianKind::exact);
  const Eigen::MatrixXd curvature = system.dense_hessian();
  const bool convex = Eigen::LLT<Eigen::MatrixXd>(curvature).info() == Eigen::Success;
  j.gradient = scaled_norm(gradient, convex ? curvature : information);
  if (seed) j.seed_nll = joint_nll(problem, *seed);
  if (std::abs(joint_nll(problem, state) - j.nll) > 1e-6 * (1.0 + std::abs(j.nll)))
    j.violation = "two programs for one NLL differ";
  if (!ask_nlopt) return;
  NloptOptions options;
  options.global_evaluations = 100;
  const JointCheck check = check_joint(problem, state, j.nll, options);
  if (!check.done) return;
  j.better_nll = check.result.nll;
  if (check.result.local_nll < j.nll - 1e-6)
    j.violation = fmt::format("NLopt goes {:.1e} nats lower from there", j.nll - check.result.local_nll);
}

/// NLopt on l_s over alpha and landmarks, the sigmas held, from the answer.
inline double nlopt_marginal(const JointProblem& problem, const JointState& answer) {
  JointSystem system(problem, static_cast<int>(answer.alpha.size()),
                     static_cast<int>(answer.noise.parameters.size()));
  const JointLayout& layout = system.layout();
  const int n = layout.phi_count;
  JointState last = answer;
  NloptProblem nlopt;
  nlopt.objective = [&](const Eigen::VectorXd& x, Eigen::VectorXd* gradient) {
    Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout.global_count);
    globals.head(n) = x;
    JointState at = step_state(problem, layout, answer, globals, Eigen::VectorXd::Zero(layout.coordinates));
    at.stops = last.stops;
    const LaplaceValue value = laplace_marginal(problem, at);
    if (!value.ok) return std::numeric_limits<double>::infinity();
    last = value.state;
    if (gradient) {
      system.assemble(value.state, HessianKind::exact);
      if (!system.eliminate()) return std::numeric_limits<double>::infinity();
      *gradient = (system.reduced_gradient() + system.log_det_gradient(value.state)).head(n);
    }
    return value.marginal_nll;
  };
  nlopt.seed = Eigen::VectorXd::Zero(n);
  system.assemble(answer, HessianKind::fisher);
  if (!system.eliminate()) return std::numeric_limits<double>::quiet_NaN();
  nlopt.whitening = whitening_from_information(system.schur().topLeftCorner(n, n));
  NloptOptions options;
  options.local_evaluations = 300;
  return nlopt_check(nlopt, options).local_nll;
}

/// The slope of the REML criterion in each log sigma, alpha and landmarks following, in standard deviations
/// of it: by differences of two solves a tenth of one apart. The largest.
inline double reml_slope(const JointProblem& problem, const JointState& answer, const Calibration& c) {
  const bool logs = answer.noise.law != NoiseLaw::polynomial;
  double largest = 0.0;
  const auto slope = [&](double deviation, auto&& moved) {
    MarginalOptions held;
    held.held.sigmas = true;
    double at[2];
    for (int side = 0; side < 2; ++side) {
      const MarginalFit fit = solve_marginal(problem, moved((side ? 0.1 : -0.1) * deviation), held);
      if (fit.outcome != Outcome::converged) return;
      at[side] = marginal_at(problem, fit.state).criterion;
    }
    largest = std::max(largest, std::abs(at[1] - at[0]) / 0.2);
  };
  if (logs && c.noise_estimates.size() == 1 && c.noise_estimates[0].std_dev)
    slope(*c.noise_estimates[0].std_dev / c.noise_estimates[0].value, [&](double change) {
      JointState s = answer;
      s.noise.parameters[0] *= std::exp(change);
      return s;
    });
  if (c.sigma_theta_rad->std_dev)
    slope(*c.sigma_theta_rad->std_dev / c.sigma_theta_rad->value, [&](double change) {
      JointState s = answer;
      s.sigma_theta_rad *= std::exp(change);
      return s;
    });
  return largest;
}

inline void judge_marginal(const JointProblem& problem, const std::optional<JointState>& seed,
                           const Calibration& c, bool ask_nlopt, Judgement& j) {
  const JointState state = *state_of(problem, c);
  const MarginalAt at = marginal_at(problem, state);
  j.nll = at.value;
  j.gradient = at.gradient;
  if (seed) j.seed_nll = marginal_at(problem, *seed).value;
  if (j.nll > j.seed_nll) {  // as it may be: the sigmas are not those of the lowest l_s, but of the lowest
                             // REML criterion
    MarginalOptions held;
    held.held.sigmas = true;
    const MarginalFit at_its_sigmas = solve_marginal(problem, *seed, held);
    if (at_its_sigmas.outcome != Outcome::converged ||
        at.criterion <= marginal_at(problem, at_its_sigmas.state).criterion)
      j.seed_nll = j.nll;
  }
  if (!ask_nlopt || !c.reason.empty()) return;
  if (const double slope = reml_slope(problem, state, c); !(slope < 0.5))
    j.violation = fmt::format("the REML criterion has a slope of {:.1e} in a sigma", slope);
  j.better_nll = nlopt_marginal(problem, state);
  if (j.better_nll < at.value - 1e-6)
    j.violation = fmt::format("NLopt goes {:.1e} nats lower from there", at.value - j.better_nll);
}

/// Calibrates the world by `full` and `marginal` and checks every claim of the two answers. `ask_nlopt`: with
/// a second program too.
inline std::vector<Judgement> judge(const World& world, bool ask_nlopt) {
  CalibrateOptions options;
  options.noise_shape = NoiseShape::gaussian;  // whose optimum is judged
  options.order = world.setting.fitted_order;
  options.noise = world.setting.fitted_law;
  if (!world.setting.estimate_sigma_s) options.methods = {Method::full, Method::marginal};
  std::vector<Judgement> judgements;
  CalibrationReport report;
  std::chrono::steady_clock::time_point begin;
  double seconds[4] = {};
  options.on_method = [&](Method method, bool begins) {
    if (begins)
      begin = std::chrono::steady_clock::now();
    else
      seconds[static_cast<int>(method)] =
          std::chrono::duration<double>(std::chrono::steady_clock::now() - begin).count();
  };
  try {
    report = calibrate_report({&world.recording, 1}, options);
  } catch (const InputError& error) {
    for (Method method : {Method::full, Method::marginal}) {
      Judgement& refused = judgements.emplace_back();
      refused.method = method;
      refused.outcome = "refused";
      refused.reason = error.what();
      refused.nll = refused.seed_nll = refused.gradient = std::numeric_limits<double>::quiet_NaN();
    }
    return judgements;
  }
  const JointProblem problem = make_joint_problem({&world.recording, 1});
  const bool whole = problem.landmark_count() > 0 && report.notes.empty();
  const std::optional<JointState> seed = seed_of(problem, *options.order, *options.noise);
  for (const Calibration& c : report.calibrations) {
    if (c.method != Method::full && c.method != Method::marginal) continue;
    Judgement j;
    j.method = c.method;
    j.outcome = to_string(c.outcome);
    j.reason = c.reason;
    j.iterations = c.iterations;
    j.seconds = seconds[static_cast<int>(c.method)];
    j.nll = j.seed_nll = j.gradient = std::numeric_limits<double>::quiet_NaN();
    if (!all_finite(c)) j.violation = "a number that is not finite";
    if (c.outcome == Outcome::converged && !c.alpha_covariance && c.covariance_reason.empty())
      j.violation = "no covariance, and not why";
    if (c.outcome != Outcome::converged && c.reason.empty()) j.violation = "an outcome without a reason";
    if (c.outcome == Outcome::unobservable && c.weakest_direction.empty())
      j.violation = "unobservable without a direction";
    if (c.outcome == Outcome::unobservable && c.alpha_covariance)
      j.violation = "unobservable with a covariance";
    if (c.outcome == Outcome::converged && j.violation.empty()) {
      if (!state_of(problem, c)) {
        if (whole) j.violation = "converged without a state";
      } else {
        (c.method == Method::full ? judge_full : judge_marginal)(problem, seed, c, ask_nlopt, j);
        if (!std::isfinite(j.nll))
          j.violation = "converged to a likelihood that is not finite";
        else if (j.violation.empty() && !(j.gradient < gradient_bar))
          j.violation = fmt::format("a gradient of {:.1e}", j.gradient);
        else if (j.violation.empty() && j.nll > j.seed_nll + 1e-9 * (1.0 + std::abs(j.seed_nll)))
          j.violation = fmt::format("{:.2g} nats worse than its seed", j.nll - j.seed_nll);
      }
    }
    judgements.push_back(j);
  }
  return judgements;
}

}  // namespace rangecal::hard
