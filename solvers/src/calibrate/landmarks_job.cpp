// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/landmarks_job.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>

#include "calibrate/too_few.hpp"
#include "calibrate/walk_seed.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"
#include "rangecal/solvers/joint_ml/robust.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

}  // namespace

LandmarksJob::LandmarksJob(std::span<const Recording> all, const CalibrateOptions& wanted,
                           CalibrationReport& report)
    : recordings(with_seen_landmarks(all)), options(wanted) {
  for (const Recording& recording : recordings) {
    add_counts(recording.counts, counts);
    for (const Landmark& landmark : recording.landmarks) landmark_labels.push_back(landmark.label);
    for (const Stop& stop : recording.stops) stop_labels.push_back(stop.label);
  }
  if (const std::vector<std::string> unseen = unseen_landmarks(all); !unseen.empty())
    report.notes.push_back(fmt::format("left out, never seen: landmark {}", fmt::join(unseen, ", ")));
  problem = make_joint_problem(recordings);
  const double scale = mean_range(problem);
  for (const Recording& recording : recordings)
    if (recording.estimate_sigma_xy)
      default_sigma_s_m = std::clamp(recording.sigma_xy_m, 4e-4 * scale, 0.1 * scale);
  if (options.noise_shape != NoiseShape::gaussian) rows = make_joint_problem(recordings, Grouping::rows);
  too_few = why_too_few(problem, options.order.value_or(1));
}

std::optional<JointState> LandmarksJob::seed(int order, NoiseLaw law) const {
  std::vector<JointState> candidates;
  ClosedFormOptions closed;
  closed.order = order;
  closed.noise_law = law;
  closed.bearings.weights = options.weights;
  if (problem.estimate_sigma_s) closed.bearings.sigma_s_m = default_sigma_s_m;
  const auto add = [&](auto&& make) {
    try {
      candidates.push_back(make());
    } catch (const InputError&) {  // this seed does not exist for this problem; others may
    }
  };
  add([&] { return closed_form_state(problem, closed); });
  if (is_walk(problem)) add([&] { return walk_seed(problem, order, law); });
  add([&] { return position_seed(problem, order, law); });
  if (options.from && !candidates.empty()) {
    JointState state = candidates.back();
    const Calibration& from = *options.from;
    for (std::size_t l = 0; l < landmark_labels.size(); ++l)
      for (const LandmarkEstimate& landmark : from.landmarks)
        if (landmark.label == landmark_labels[l] && landmark.recording == problem.landmark_recording[l])
          state.landmarks[l] = landmark.position_m;
    add([&] {
      seed_curve_and_noise(problem, order, state);
      return state;
    });
    if (from.order() <= order) {
      state.alpha = Eigen::VectorXd::Zero(order + 1);
      state.alpha.head(from.alpha.size()) = from.alpha;
      if (from.noise.law == law) state.noise = from.noise;
      if (from.sigma_theta_rad) state.sigma_theta_rad = from.sigma_theta_rad->value;
      candidates.push_back(state);
    }
  }
  std::optional<JointState> best;
  double best_nll = infinity;
  for (JointState& state : candidates) {
    if (problem.estimate_sigma_s) state.sigma_s_m = default_sigma_s_m;
    const double nll = joint_nll(problem, state);
    if (nll < best_nll) {
      best_nll = nll;
      best = state;
    }
  }
  return best;
}

JointFit LandmarksJob::full(const JointState& start) const {
  if (options.solver == JointSolver::block) return solve_joint_block(problem, start);
  JointFit fit = solve_joint_ceres(problem, start);
  if (fit.outcome != Outcome::not_converged) return fit;
  // Sums of squares that round away what is left to gain, or a sigma that creeps to 0: exact second derivatives see both.
  JointFit other = solve_joint_block(problem, start);
  return other.outcome == Outcome::not_converged && !(other.joint_nll < fit.joint_nll) ? fit : other;
}

MarginalFit LandmarksJob::marginal(const JointState& start, const JointFit* full_fit) const {
  MarginalOptions marginal;
  marginal.estimate_sigma_s = problem.estimate_sigma_s;
  MarginalFit best = marginal_by_joint(start, full_fit, marginal);
  // The joint likelihood may lead into another basin than that of the seed, and a higher one.
  const LaplaceValue at_seed = laplace_marginal(problem, start);
  const auto stands = [&](const MarginalFit& fit) {
    return fit.outcome == Outcome::converged && fit.marginal_nll <= at_seed.marginal_nll;
  };
  if (!at_seed.ok || best.outcome == Outcome::unobservable || stands(best)) return best;
  if (MarginalFit direct = solve_marginal(problem, start, marginal);
      stands(direct) && !(best.outcome == Outcome::converged && best.marginal_nll < direct.marginal_nll))
    return direct;
  // REML's sigmas are not those of the lowest l_s: the criterion decides.
  if (best.outcome == Outcome::converged && reml_at(best.state) > reml_at(start)) {
    best.outcome = Outcome::not_converged;
    best.reason = fmt::format("ended {:.2g} nats above its start", best.marginal_nll - at_seed.marginal_nll);
  }
  return best;
}

double LandmarksJob::reml_at(const JointState& state) const {
  MarginalOptions held;
  held.held.sigmas = true;
  const MarginalFit fit = solve_marginal(problem, state, held);
  if (fit.outcome != Outcome::converged || !fit.covariance) return infinity;
  const Eigen::Index n = state.alpha.size() + 2 * problem.landmark_count();
  const Eigen::LLT<Eigen::MatrixXd> factor(fit.covariance->topLeftCorner(n, n));
  return fit.marginal_nll - factor.matrixLLT().diagonal().array().log().sum();
}

MarginalFit LandmarksJob::marginal_by_joint(const JointState& start, const JointFit* full_fit,
                                            const MarginalOptions& marginal) const {
  MarginalFit best;
  if (full_fit && full_fit->outcome == Outcome::converged && !problem.estimate_sigma_s) {
    best = solve_marginal(problem, full_fit->state, marginal);
    if (best.outcome == Outcome::converged) return best;
  }
  JointState held_start = start;
  ClosedFormOptions closed;
  closed.order = static_cast<int>(start.alpha.size()) - 1;
  closed.noise_law = start.noise.law;
  if (problem.estimate_sigma_s) closed.bearings.sigma_s_m = default_sigma_s_m;
  const Calibration approximate = approximate_joint_calibration(problem, closed);
  if (is_usable(approximate.outcome) && approximate.noise.parameters.allFinite() &&
      approximate.noise.parameters.cwiseAbs().maxCoeff() > 0.0) {
    if (approximate.noise.law == start.noise.law) held_start.noise = approximate.noise;
    if (approximate.sigma_theta_rad && approximate.sigma_theta_rad->value > 0.0)
      held_start.sigma_theta_rad = approximate.sigma_theta_rad->value;
  }
  JointOptions held;
  held.held.sigmas = true;
  for (const JointState& from : {held_start, start}) {
    const JointFit fit = solve_joint_block(problem, from, held);
    if (!std::isfinite(fit.joint_nll)) continue;
    MarginalFit next = solve_marginal(problem, fit.state, marginal);
    if (next.outcome == Outcome::converged || next.outcome == Outcome::unobservable) return next;
    if (best.state.alpha.size() == 0 || next.marginal_nll < best.marginal_nll) best = next;
  }
  return best;
}

double LandmarksJob::parameters(const JointState& state) const { return parameter_count(problem, state); }

double parameter_count(const JointProblem& problem, const JointState& state, bool pairs) {
  const auto curve_and_noise = static_cast<double>(state.alpha.size() + state.noise.parameters.size());
  if (pairs) return curve_and_noise;
  return curve_and_noise + 1.0 + 2.0 * problem.landmark_count() + (problem.estimate_sigma_s ? 1.0 : 0.0);
}

std::pair<int, NoiseLaw> LandmarksJob::choose_model(std::vector<ModelScore>& models,
                                                    std::vector<TriedCurve>& curves) const {
  const int highest = std::min(options.max_order, static_cast<int>(problem.cells.size()) - 3);
  const std::vector<NoiseLaw> laws =
      options.noise
          ? std::vector<NoiseLaw>{*options.noise}
          : std::vector<NoiseLaw>{NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed};
  int order = options.order.value_or(std::clamp(highest, 1, 2));
  NoiseLaw law = options.noise.value_or(NoiseLaw::f_squared);
  if (options.order && options.noise) return {order, law};

  std::map<std::pair<int, NoiseLaw>, double> known;
  std::optional<JointState> warm;
  const auto aic_of = [&](int n, NoiseLaw candidate) {
    const auto found = known.find({n, candidate});
    if (found != known.end()) return found->second;
    if (options.on_progress)
      options.on_progress(fmt::format("trying order {} with noise law {}", n, to_string(candidate)));
    ModelScore tried{n, candidate, infinity, infinity};
    TriedCurve curve;
    const auto keep = [&](const JointFit& tried_fit) {
      curve.alpha = tried_fit.state.alpha;
      if (tried_fit.covariance) curve.covariance = tried_fit.covariance->topLeftCorner(n + 1, n + 1);
    };
    MarginalFit fit;
    MarginalOptions marginal_options;
    marginal_options.estimate_sigma_s = problem.estimate_sigma_s;
    if (warm) {
      JointState start = *warm;
      start.noise.law = candidate;
      seed_curve_and_noise(problem, n, start);
      fit = solve_marginal(problem, start, marginal_options);
    }
    if (fit.outcome != Outcome::converged)
      if (const auto start = seed(n, candidate)) {
        const JointFit joint = problem.estimate_sigma_s ? JointFit{} : solve_joint_block(problem, *start);
        fit = marginal(*start, &joint);
      }
    if (fit.outcome == Outcome::converged) {
      tried.nll = fit.marginal_nll;
      tried.aic = 2.0 * (fit.marginal_nll + parameters(fit.state));
      keep(fit);
      warm = fit.state;
      if (problem.estimate_sigma_s && warm->sigma_s_m && *warm->sigma_s_m < 10.0 * no_sigma_s(problem))
        warm.reset();
      if (rows) {
        const bool any = options.noise_shape == NoiseShape::automatic;
        const RobustMarginalFit robust = solve_marginal_robust(
            *rows, fit.state, any ? NoiseShape::student_t : options.noise_shape, marginal_options);
        tried.nll = robust.shapes.nll;
        tried.aic = is_usable(robust.fit.outcome) ? robust.shapes.aic : infinity;
        curve.covariance.reset();
        keep(robust.fit);
      }
    }
    curve.aic = tried.aic;
    curves.push_back(curve);
    models.push_back(tried);
    return known[{n, candidate}] = tried.aic;
  };
  const auto best_law = [&] {
    for (NoiseLaw candidate : laws)
      if (aic_of(order, candidate) < aic_of(order, law)) law = candidate;
  };
  best_law();
  const int first_order = order;
  if (!options.order)
    for (int n = 1; n <= std::max(1, highest); ++n)
      if (aic_of(n, law) < aic_of(order, law)) order = n;
  if (order != first_order) best_law();
  if (!options.order && !std::isfinite(known[{order, law}])) order = 1;
  return {order, law};
}

}  // namespace rangecal
