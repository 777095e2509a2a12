// SPDX-License-Identifier: BSD-3-Clause
#include "study/repeat_estimates.hpp"

#include <ctime>

#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/closed_form/pairs_approximate.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"
#include "rangecal/solvers/statistics/information_criteria.hpp"

namespace rangecal {
namespace {

CalibrateOptions job_options() {
  CalibrateOptions options;
  options.solver = JointSolver::block;
  return options;
}

ClosedFormOptions closed_options(const StudyEstimator& estimator, const RepeatModel& model) {
  ClosedFormOptions options;
  options.order = model.order;
  options.max_order = model.max_order;
  options.noise_law = model.law;
  options.criterion = estimator.criterion;
  options.bearings.weights = estimator.weights;
  return options;
}

RepeatEstimate from_calibration(const Calibration& calibration, NoiseLaw law) {
  RepeatEstimate result;
  result.outcome = calibration.outcome;
  if (calibration.outcome != Outcome::converged) return result;
  result.alpha = calibration.alpha;
  result.alpha_covariance = calibration.alpha_covariance;
  if (calibration.noise.law == law && calibration.noise.parameters.size() == 1 &&
      calibration.noise.parameters[0] > 0.0)
    result.sigma_e = calibration.noise.parameters[0];
  if (calibration.sigma_theta_rad) result.sigma_theta = calibration.sigma_theta_rad->value;
  bool all = !calibration.landmarks.empty();
  for (const LandmarkEstimate& landmark : calibration.landmarks) {
    result.landmarks.push_back(landmark.position_m);
    all = all && landmark.covariance.has_value();
  }
  if (!all) return result;
  result.landmark_variance.resize(2 * static_cast<Eigen::Index>(result.landmarks.size()));
  for (std::size_t l = 0; l < result.landmarks.size(); ++l)
    result.landmark_variance.segment<2>(2 * static_cast<Eigen::Index>(l)) =
        calibration.landmarks[l].covariance->diagonal();
  return result;
}

void fill_from_fit(const JointFit& fit, RepeatEstimate& result) {
  result.outcome = fit.outcome;
  if (fit.outcome != Outcome::converged) return;
  result.alpha = fit.state.alpha;
  result.landmarks = fit.state.landmarks;
  if (has_sigma(fit.state.noise.law)) result.sigma_e = fit.state.noise.parameters[0];
  result.sigma_theta = fit.state.sigma_theta_rad;
  if (!fit.covariance) return;
  const Eigen::Index alphas = fit.state.alpha.size();
  result.alpha_covariance = fit.covariance->topLeftCorner(alphas, alphas);
  result.landmark_variance =
      fit.covariance->diagonal().segment(alphas, 2 * static_cast<Eigen::Index>(fit.state.landmarks.size()));
}

/// AIC of the approximate fits with a given order's Gaussian of (21) [nats].
std::vector<double> approximate_aic(const Recording& recording, int max_order) {
  std::vector<double> scores;
  for (int n = 1; n <= max_order; ++n) {
    const PairsApproximate fit = approximate_pairs_fit(recording.pairs.true_m, recording.pairs.reading_m, n);
    scores.push_back(is_usable(fit.outcome) ? aic(fit.nll, n + 2.0) : std::nan(""));
  }
  return scores;
}

}  // namespace

double thread_seconds() {
  timespec now{};
  ::clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
  return static_cast<double>(now.tv_sec) + 1e-9 * static_cast<double>(now.tv_nsec);
}

LandmarkEstimates::LandmarkEstimates(const Recording& recording)
    : job_({&recording, 1}, job_options(), report_) {
  for (const std::string& label : job_.landmark_labels)
    for (std::size_t l = 0; l < recording.landmarks.size(); ++l)
      if (recording.landmarks[l].label == label) seen_.push_back(static_cast<int>(l));
}

const LandmarkEstimates::Joint& LandmarkEstimates::joint(int order, NoiseLaw law, RepeatEstimate& estimate) {
  for (const Joint& known : joints_)
    if (known.order == order && known.law == law) {
      estimate.shared_seconds += known.seconds;
      return known;
    }
  const double begin = thread_seconds();
  Joint& fresh = joints_.emplace_back();
  fresh.order = order;
  fresh.law = law;
  fresh.seed = job_.seed(order, law);
  if (fresh.seed) fresh.full = job_.full(*fresh.seed);
  fresh.seconds = thread_seconds() - begin;
  return fresh;
}

int LandmarkEstimates::selected_order(const RepeatModel& model) {
  job_.options.order.reset();
  job_.options.max_order = model.max_order;
  job_.options.noise = model.law;
  std::vector<ModelScore> tried;
  std::vector<TriedCurve> curves;
  return job_.choose_model(tried, curves).order;
}

RepeatEstimate LandmarkEstimates::closed(const StudyEstimator& estimator, const RepeatModel& model) const {
  const ClosedFormOptions options = closed_options(estimator, model);
  RepeatEstimate result = from_calibration(estimator.method == Method::closed_form
                                               ? closed_form_calibration(job_.problem, options)
                                               : approximate_joint_calibration(job_.problem, options),
                                           model.law);
  if (result.outcome == Outcome::converged && result.alpha.size() == 0) result.outcome = Outcome::failed;
  return result;
}

RepeatEstimate LandmarkEstimates::estimate(const StudyEstimator& estimator, const RepeatModel& model) {
  RepeatEstimate result;
  if (job_.too_few) {
    result.outcome = Outcome::too_few_data;
    return result;
  }
  switch (estimator.method) {
    case Method::closed_form:
    case Method::approximate:
      return closed(estimator, model);
    case Method::full:
    case Method::marginal:
      break;
  }
  const int order = model.order ? *model.order : selected_order(model);
  const Joint& shared = joint(order, model.law, result);
  if (!shared.seed) return result;
  if (estimator.method == Method::full)
    fill_from_fit(shared.full, result);
  else
    fill_from_fit(job_.marginal(*shared.seed, &shared.full), result);
  return result;
}

namespace {

RepeatEstimate approximate_estimate(const Recording& recording, const StudyEstimator& estimator,
                                    const RepeatModel& model) {
  ClosedFormOptions options = closed_options(estimator, model);
  std::vector<double> scores;
  if (!model.order) {
    scores = approximate_aic(recording, model.max_order);
    int best = 0;
    for (std::size_t i = 1; i < scores.size(); ++i)
      if (scores[i] < scores[best]) best = static_cast<int>(i);
    options.order = best + 1;
  }
  RepeatEstimate result = from_calibration(approximate_pairs(recording, options), model.law);
  result.aic_by_order = std::move(scores);
  return result;
}

RepeatEstimate likelihood_estimate(const PairsProblem& problem, Method method, const RepeatModel& model) {
  PairsOptions options;
  options.order = model.order;
  options.max_order = model.max_order;
  options.law = model.law;
  const PairsFit fit =
      method == Method::full ? full_pairs(problem, options) : marginal_pairs(problem, options);
  RepeatEstimate result = from_calibration(fit.calibration, model.law);
  if (!model.order)
    for (const OrderScore& score : fit.orders)
      result.aic_by_order.push_back(score.outcome == Outcome::converged ? score.aic : std::nan(""));
  return result;
}

}  // namespace

RepeatEstimate estimate_pairs(const Recording& recording, const PairsProblem& problem,
                              const StudyEstimator& estimator, const RepeatModel& model) {
  switch (estimator.method) {
    case Method::closed_form:
      return from_calibration(closed_form_pairs(recording, closed_options(estimator, model)), model.law);
    case Method::approximate:
      return approximate_estimate(recording, estimator, model);
    case Method::full:
    case Method::marginal:
      return likelihood_estimate(problem, estimator.method, model);
  }
  return {};
}

}  // namespace rangecal
