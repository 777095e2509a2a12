// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <regex>

#include "calibrate/landmarks_job.hpp"
#include "calibrate/observability.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

void fill_deviations(const JointProblem& problem, const JointFit& fit, Calibration& result) {
  const int alphas = static_cast<int>(fit.state.alpha.size()),
            taus = static_cast<int>(fit.state.noise.parameters.size());
  const Eigen::MatrixXd* covariance = fit.covariance ? &*fit.covariance : nullptr;
  const JointLayout layout(
      problem, alphas, taus,
      covariance && covariance->rows() > alphas + 2 * problem.landmark_count() + taus + 1);
  const bool logs = has_sigma(fit.state.noise.law);
  const auto std_dev = [&](int index, double factor) -> std::optional<double> {
    if (!covariance || !((*covariance)(index, index) >= 0.0)) return std::nullopt;
    return factor * std::sqrt((*covariance)(index, index));
  };
  if (covariance) result.alpha_covariance = covariance->topLeftCorner(alphas, alphas);
  for (int j = 0; j < taus; ++j) {
    const double value = fit.state.noise.parameters[j];
    result.noise_estimates.push_back({value, std_dev(layout.tau_begin + j, logs ? value : 1.0)});
  }
  if (problem.reads_bearings)
    result.sigma_theta_rad =
        Estimate{fit.state.sigma_theta_rad, std_dev(layout.sigma_theta, fit.state.sigma_theta_rad)};
  if (problem.estimate_sigma_s && fit.state.sigma_s_m) {
    result.sigma_s_m = Estimate{*fit.state.sigma_s_m, std::nullopt};
    if (layout.sigma_s >= 0) result.sigma_s_m->std_dev = std_dev(layout.sigma_s, *fit.state.sigma_s_m);
  }
  for (int l = 0; covariance && l < problem.landmark_count(); ++l)
    result.landmarks[l].covariance =
        covariance->block<2, 2>(layout.landmark_begin + 2 * l, layout.landmark_begin + 2 * l);
}

}  // namespace

std::string with_labels(const std::string& text, const std::vector<std::string>& labels) {
  static const std::regex pattern("landmark ([0-9]+)");
  std::string result;
  auto from = text.begin();
  for (std::sregex_iterator match(text.begin(), text.end(), pattern), end; match != end; ++match) {
    result.append(from, (*match)[0].first);
    const std::size_t index = std::stoul((*match)[1].str());
    result += "landmark " + (index < labels.size() ? labels[index] : (*match)[1].str());
    from = (*match)[0].second;
  }
  result.append(from, text.end());
  return result;
}

std::string in_user_words(const std::string& direction, const std::vector<std::string>& labels,
                          NoiseLaw law) {
  const bool beta = !has_sigma(law);
  static const std::regex pattern("noise parameter ([0-9]+)");
  return std::regex_replace(with_labels(direction, labels), pattern, beta ? "beta_$1" : "log sigma_e");
}

Calibration calibration_from_fit(const LandmarksJob& job, Method method, const JointFit& fit) {
  Calibration result;
  result.method = method;
  result.counts = job.counts;
  result.outcome = fit.outcome;
  result.reason = with_labels(fit.reason, job.landmark_labels);
  result.iterations = fit.iterations;
  if (fit.outcome == Outcome::unbounded || fit.outcome == Outcome::failed || fit.state.alpha.size() == 0) {
    result.covariance_reason = "no optimum, so no covariance";
    return result;
  }
  result.weakest_direction = in_user_words(fit.weakest_direction, job.landmark_labels, fit.state.noise.law);
  result.covariance_reason = with_labels(fit.covariance_reason, job.landmark_labels);
  result.alpha = fit.state.alpha;
  result.noise = fit.state.noise;
  for (std::size_t l = 0; l < job.landmark_labels.size(); ++l)
    result.landmarks.push_back({job.problem.landmark_recording[l], job.landmark_labels[l],
                                fit.state.landmarks[l], std::nullopt, std::nullopt});
  for (std::size_t k = 0; k < job.stop_labels.size(); ++k)
    result.stops.push_back({job.problem.stops[k].recording, job.stop_labels[k], fit.state.stops[k]});
  fill_deviations(job.problem, fit, result);
  fill_range(job.problem, fit.state, result);
  if (method == Method::full && result.alpha_covariance)
    result.covariance_reason =
        "optimistic: the joint maximum fits the stops as if they were known afterwards, so its sigmas, and "
        "with them "
        "these standard deviations, come out too small";
  return result;
}

Calibration calibration_by_closed_form(const LandmarksJob& job, Method method, int order, NoiseLaw law) {
  ClosedFormOptions closed;
  closed.order = order;
  closed.noise_law = law;
  closed.bearings.weights = job.options.weights;
  if (job.problem.estimate_sigma_s) closed.bearings.sigma_s_m = job.default_sigma_s_m;
  Calibration result;
  if (method == Method::closed_form) {
    SolverLog log("closed-form");
    if (log.on()) log.of(curve_in_words(order + 1, law));
    result = closed_form_calibration(job.agreeing, closed);
    log.end(-1, not_known, not_known, result.outcome, result.reason);
  } else {
    result = approximate_joint_calibration(job.agreeing, closed);
  }
  result.method = method;
  result.counts = job.counts;
  result.reason = with_labels(result.reason, job.landmark_labels);
  result.weakest_direction = with_labels(result.weakest_direction, job.landmark_labels);
  for (std::size_t l = 0; l < result.landmarks.size() && l < job.landmark_labels.size(); ++l)
    result.landmarks[l].label = job.landmark_labels[l];
  if (result.alpha.size() == 0 && result.outcome == Outcome::converged) result.outcome = Outcome::failed;
  if (result.outcome == Outcome::failed ||
      result.outcome == Outcome::too_few_data) {  // no numbers beside no answer
    result.alpha.resize(0);
    result.alpha_covariance.reset();
    result.noise_estimates.clear();
    result.sigma_theta_rad.reset();
    result.covariance_reason = "no estimate, so no covariance";
  }
  return result;
}

namespace {

/// Both likelihoods at the stops that are best for the rest of `state`; marginal_nll is NaN where there are none.
LaplaceValue at_best_stops(const LandmarksJob& job, JointState state, const RobustShapes* shapes) {
  if (!shapes) return laplace_marginal(job.problem, state);
  constexpr int iterations = 20;
  constexpr double settled = 1e-6;  // [nats]
  LaplaceValue value;
  for (int iteration = 0; iteration < iterations; ++iteration) {  // the weights go with the stops
    const LaplaceValue moved =
        laplace_marginal(weighted_problem(*job.rows, state, shapes->range, shapes->bearing), state);
    if (!moved.ok) return moved;
    state = moved.state;
    const RobustNll nll = robust_nll(*job.rows, state, shapes->range, shapes->bearing);
    const double before = value.joint_nll;
    value.state = state;
    value.ok = nll.ok;
    value.joint_nll = nll.joint;
    value.marginal_nll = nll.marginal;
    if (iteration > 0 && !(before - nll.joint > settled)) break;
  }
  return value;
}

}  // namespace

void score(const LandmarksJob& job, std::optional<double> sigma_s_m, std::optional<double> sigma_theta_rad,
           const RobustShapes* shapes, Calibration& calibration) {
  if (calibration.alpha.size() == 0 || calibration.landmarks.size() != job.landmark_labels.size()) return;
  JointState state;
  state.alpha = calibration.alpha;
  state.noise = calibration.noise;
  if (!job.problem.reads_bearings)
    state.sigma_theta_rad = SilentBearing::sigma_theta_rad;
  else if (calibration.sigma_theta_rad)
    state.sigma_theta_rad = calibration.sigma_theta_rad->value;
  else if (sigma_theta_rad)
    state.sigma_theta_rad = *sigma_theta_rad;
  if (job.problem.estimate_sigma_s)
    state.sigma_s_m = std::max(sigma_s_m.value_or(job.default_sigma_s_m), no_sigma_s(job.problem));
  for (const LandmarkEstimate& landmark : calibration.landmarks)
    state.landmarks.push_back(landmark.position_m);
  for (std::size_t k = 0; k < job.problem.stops.size(); ++k)
    state.stops.push_back(calibration.stops.size() == job.problem.stops.size()
                              ? calibration.stops[k].pose
                              : job.problem.stops[k].commanded);
  LaplaceValue value;
  try {
    value = at_best_stops(job, state, shapes);
  } catch (const InputError&) {  // outside of the model's domain
    value.ok = false;
  }
  if (!value.ok) {
    calibration.reason += std::string(calibration.reason.empty() ? "" : "; ") +
                          "no likelihood: f, a distance or a spread is not positive at some reading";
    return;
  }
  calibration.joint_nll = value.joint_nll;
  calibration.marginal_nll = value.marginal_nll;
  const int of_shapes =
      shapes ? shape_parameter_count(shapes->range.shape) + shape_parameter_count(shapes->bearing.shape) : 0;
  calibration.aic = 2.0 * (value.marginal_nll + job.parameters(state) + of_shapes);
}

}  // namespace rangecal
