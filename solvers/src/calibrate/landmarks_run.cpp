// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "calibrate/noise_shapes.hpp"
#include "calibrate/what_is_open.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/calibrate/doubts.hpp"
#include "rangecal/solvers/nlopt/joint_check.hpp"

namespace rangecal {
namespace {

/// The parts of a job that several methods share, each solved when first asked for.
class Run {
 public:
  explicit Run(const LandmarksJob& job, int order, NoiseLaw law) : job_(job), seed_(job.seed(order, law)) {}

  const std::optional<JointState>& seed() const { return seed_; }
  /// Where the likelihood stands best: the marginal's end, else the full's, else the seed.
  std::optional<JointState> best_state;

  const JointFit* full() {
    if (!full_ && seed_ && !job_.problem.estimate_sigma_s) {
      full_ = job_.full(*seed_);
      if (full_->outcome == Outcome::converged && !best_state) best_state = full_->state;
    }
    return full_ ? &*full_ : nullptr;
  }

  const MarginalFit* marginal() {
    if (!marginal_ && seed_) {
      marginal_ = job_.marginal(*seed_, full());
      keep(*marginal_);
    }
    return marginal_ ? &*marginal_ : nullptr;
  }

  /// `marginal` with the noise shape asked for, from the Gaussian's end; none without a seed.
  const RobustMarginalFit* shaped_marginal() {
    if (!shaped_ && seed_) {
      MarginalOptions options;
      options.estimate_sigma_s = job_.problem.estimate_sigma_s;
      const JointState& start = is_usable(marginal()->outcome) && best_state ? *best_state : *seed_;
      shaped_ = solve_marginal_robust(*job_.rows, start, job_.options.noise_shape, options);
      keep(shaped_->fit);
    }
    return shaped_ ? &*shaped_ : nullptr;
  }

  /// The shape that all methods share: the one asked for; for `automatic` that of the marginal's lowest AIC.
  NoiseShape shape() {
    const NoiseShape asked = job_.options.noise_shape;
    if (asked != NoiseShape::automatic) return asked;
    return shaped_marginal() ? shaped_marginal()->shapes.range.shape : NoiseShape::gaussian;
  }

 private:
  void keep(const MarginalFit& fit) {
    if (fit.state.alpha.size() == 0 || !std::isfinite(fit.joint_nll)) return;
    best_state = fit.state;
    if (best_state->sigma_s_m)
      best_state->sigma_s_m = std::max(*best_state->sigma_s_m, no_sigma_s(job_.problem));
  }

  const LandmarksJob& job_;
  std::optional<JointState> seed_;
  std::optional<JointFit> full_;
  std::optional<MarginalFit> marginal_;
  std::optional<RobustMarginalFit> shaped_;
};

Calibration named(const LandmarksJob& job, Method method, Outcome outcome, const std::string& reason) {
  Calibration result;
  result.method = method;
  result.outcome = outcome;
  result.reason = reason;
  result.counts = job.counts;
  result.covariance_reason = "no estimate, so no covariance";
  return result;
}

Calibration by_full(const LandmarksJob& job, Run& run) {
  if (job.problem.estimate_sigma_s)
    return named(
        job, Method::full, Outcome::unbounded,
        "with sigma_xy_m: estimate the joint likelihood has no maximum: sigma_s goes to 0; use marginal");
  const JointFit* fit = run.full();
  if (!fit) return named(job, Method::full, Outcome::failed, "no start inside the model's domain was found");
  const NoiseShape shape = run.shape();
  if (shape == NoiseShape::gaussian) return calibration_from_fit(job, Method::full, *fit);
  const JointState& start = fit->outcome == Outcome::converged ? fit->state : *run.seed();
  return calibration_from_robust(job, solve_joint_robust(*job.rows, start, shape));
}

Calibration by_marginal(const LandmarksJob& job, Run& run) {
  if (!run.seed())
    return named(job, Method::marginal, Outcome::failed, "no start inside the model's domain was found");
  if (run.shape() != NoiseShape::gaussian) return calibration_from_robust(job, *run.shaped_marginal());
  const MarginalFit& fit = *run.marginal();
  Calibration result = calibration_from_fit(job, Method::marginal, fit);
  result.sigma_s_upper95_m = fit.sigma_s_upper95_m;
  return result;
}

Calibration by_method(const LandmarksJob& job, Method method, int order, NoiseLaw law, Run& run) {
  switch (method) {
    case Method::closed_form:
    case Method::approximate:
      return calibration_by_closed_form(job, method, order, law);
    case Method::full:
      return by_full(job, run);
    case Method::marginal:
      return by_marginal(job, run);
  }
  return named(job, method, Outcome::failed, "it is no method for landmarks");
}

/// NLopt on the joint NLL from `seed`, against the optimum `fit`. Where it ends higher, the seed lies in another basin
/// than the one that Newton's longer steps end in: then NLopt starts from there.
CheckReport checked(const LandmarksJob& job, const JointState& seed, const JointFit& fit) {
  CheckReport report;
  if (fit.outcome != Outcome::converged && fit.outcome != Outcome::unobservable) {
    report.report = "no check: the joint likelihood has no optimum here to compare with";
    return report;
  }
  NloptOptions options;
  options.global_evaluations = 200;
  JointCheck check = check_joint(job.problem, seed, fit.joint_nll, options);
  if (check.done && !check.result.agrees && !check.result.better_basin)
    check = check_joint(job.problem, fit.state, fit.joint_nll, options);
  if (check.done) return check_report(check.result);
  report.report = "no check: " + check.reason;
  return report;
}

/// What the shapes that were tried cost against the one kept.
void note_tried(const RobustShapes& shapes, CalibrationReport& report) {
  std::string text;
  for (const auto& [shape, aic] : shapes.tried)
    text += fmt::format("{}{} {:+.1f}", text.empty() ? "" : ", ", to_string(shape), aic - shapes.aic);
  report.notes.push_back(
      fmt::format("noise shape by AIC: {} is kept ({})", to_string(shapes.range.shape), text));
}

/// What is asked for and does not exist for landmarks.
void refuse_what_is_not(std::span<const Recording> recordings, const CalibrateOptions& options) {
  if (options.criterion != OrderCriterion::aic)
    throw InputError(
        fmt::format("{}: criterion {} is for known distances (kind: pairs); of landmarks order and noise "
                    "law go by aic of the marginal likelihood",
                    recordings[0].path, to_string(options.criterion)));
  const bool by_name = !options.methods.empty() && options.methods.size() < all_methods().size() &&
                       std::count(options.methods.begin(), options.methods.end(), Method::full) > 0;
  for (const Recording& recording : recordings)
    if (by_name && recording.estimate_sigma_xy)
      throw InputError(recording.path +
                       ": method full cannot estimate sigma_xy_m, its likelihood has no maximum there; "
                       "use --method marginal, or give sigma_xy_m a value");
}

/// What the recording leaves open, of every method; and what the closed form alone could not tell.
void mark_what_is_open(const LandmarksJob& job, const std::optional<JointState>& at,
                       CalibrationReport& report) {
  if (const auto open = at ? what_is_open(job.problem, *at) : std::nullopt)
    for (Calibration& calibration : report.calibrations) mark_open(job.problem, *open, *at, calibration);
  for (Calibration& calibration : report.calibrations) {
    if (calibration.outcome != Outcome::unobservable || calibration.alpha.size() > 0) continue;
    if (at)
      mark_open(job.problem, std::string(calibration.reason), *at, calibration);
    else
      calibration.outcome = Outcome::failed;
  }
}

}  // namespace

void calibrate_landmarks(std::span<const Recording> recordings, const CalibrateOptions& options,
                         CalibrationReport& report) {
  refuse_what_is_not(recordings, options);
  const LandmarksJob job(recordings, options, report);
  const std::vector<Method> methods = methods_of(options);
  if (job.too_few) {
    for (Method method : methods)
      report.calibrations.push_back(named(job, method, Outcome::too_few_data, *job.too_few));
    return;
  }
  if (job.problem.landmark_count() < 3)
    report.notes.push_back("fewer than 3 landmarks: a moved landmark or a wrong label would go unnoticed");
  const int lowest = options.order.value_or(1);
  if (const auto exact =
          order_without_noise(job.problem, lowest, options.order.value_or(options.max_order))) {
    for (Method method : methods)
      report.calibrations.push_back(named(job, method, Outcome::unbounded, without_noise(*exact)));
    return;
  }
  std::vector<TriedCurve> curves;
  const auto [order, law] = job.choose_model(report.models, curves);
  Run run(job, order, law);
  for (Method method : methods) {
    if (options.on_progress) options.on_progress(fmt::format("solving {}", to_string(method)));
    if (options.on_method) options.on_method(method, true);
    report.calibrations.push_back(by_method(job, method, order, law, run));
    if (options.on_method) options.on_method(method, false);
  }
  std::optional<double> sigma_s, sigma_theta;
  for (const Calibration& calibration : report.calibrations) {
    if (calibration.sigma_s_m) sigma_s = calibration.sigma_s_m->value;
    if (calibration.sigma_theta_rad) sigma_theta = calibration.sigma_theta_rad->value;
  }
  const bool gaussian = run.shape() == NoiseShape::gaussian;
  for (Calibration& calibration : report.calibrations)
    if (gaussian) score(job, sigma_s, sigma_theta, calibration);
  for (Calibration& calibration : report.calibrations)
    if (calibration.method == Method::marginal)  // the others' curves at other orders are not known
      calibration.covariance_with_choice = covariance_with_choice(calibration, curves);
  report_shapes(report);
  if (options.noise_shape == NoiseShape::automatic && run.shaped_marginal())
    note_tried(run.shaped_marginal()->shapes, report);
  mark_what_is_open(job, run.best_state ? run.best_state : run.seed(), report);
  if (options.check && gaussian && !job.problem.estimate_sigma_s && run.seed()) {
    if (options.on_progress) options.on_progress("checking the joint optimum with NLopt");
    report.check = checked(job, *run.seed(), *run.full());
  }
}

}  // namespace rangecal
