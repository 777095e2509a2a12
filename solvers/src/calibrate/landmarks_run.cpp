// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>

#include "calibrate/landmarks_job.hpp"
#include "rangecal/core/errors.hpp"

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

 private:
  const LandmarksJob& job_;
  std::optional<JointState> seed_;
  std::optional<JointFit> full_;
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
  return calibration_from_fit(job, Method::full, *fit);
}

Calibration by_marginal(const LandmarksJob& job, Run& run) {
  if (!run.seed())
    return named(job, Method::marginal, Outcome::failed, "no start inside the model's domain was found");
  const MarginalFit fit = job.marginal(*run.seed(), run.full());
  Calibration result = calibration_from_fit(job, Method::marginal, fit);
  result.sigma_s_upper95_m = fit.sigma_s_upper95_m;
  if (fit.state.alpha.size() > 0 && std::isfinite(fit.joint_nll)) {
    run.best_state = fit.state;
    // An estimate of 0 has no density; a micrometre is below what any recording resolves.
    if (run.best_state->sigma_s_m) run.best_state->sigma_s_m = std::max(*run.best_state->sigma_s_m, 1e-6);
  }
  return result;
}

}  // namespace

void calibrate_landmarks(std::span<const Recording> recordings, const CalibrateOptions& options,
                         CalibrationReport& report) {
  if (options.noise_shape != NoiseShape::gaussian)
    throw InputError("noise shape " + std::string(to_string(options.noise_shape)) +
                     " is for recordings of kind pairs; with landmarks the likelihood is gaussian");
  const bool by_name = !options.methods.empty() && options.methods.size() < 4 &&
                       std::count(options.methods.begin(), options.methods.end(), Method::full) > 0;
  for (const Recording& recording : recordings)
    if (by_name && recording.estimate_sigma_xy)
      throw InputError(recording.path +
                       ": method full cannot estimate sigma_xy_m, its likelihood has no maximum there; "
                       "use --method marginal, or give sigma_xy_m a value");
  const LandmarksJob job(recordings, options, report);
  const std::vector<Method> methods = methods_of(options);
  if (job.too_few) {
    for (Method method : methods)
      report.calibrations.push_back(named(job, method, Outcome::too_few_data, *job.too_few));
    return;
  }
  if (job.problem.landmark_count() < 3)
    report.notes.push_back("fewer than 3 landmarks: a moved landmark or a wrong label would go unnoticed");
  const auto [order, law] = job.choose_model(report.models);
  Run run(job, order, law);
  for (Method method : methods) {
    if (options.on_progress) options.on_progress(fmt::format("solving {}", to_string(method)));
    if (options.on_method) options.on_method(method, true);
    report.calibrations.push_back(method == Method::full ? by_full(job, run)
                                  : method == Method::marginal
                                      ? by_marginal(job, run)
                                      : calibration_by_closed_form(job, method, order, law));
    if (options.on_method) options.on_method(method, false);
  }
  std::optional<double> sigma_s, sigma_theta;
  for (const Calibration& calibration : report.calibrations) {
    if (calibration.sigma_s_m) sigma_s = calibration.sigma_s_m->value;
    if (calibration.sigma_theta_rad) sigma_theta = calibration.sigma_theta_rad->value;
  }
  for (Calibration& calibration : report.calibrations) score(job, sigma_s, sigma_theta, calibration);
  const std::optional<JointState> at = run.best_state ? run.best_state : run.seed();
  if (const auto open = at ? what_is_open(job, *at) : std::nullopt)
    for (Calibration& calibration : report.calibrations) mark_open(job, *open, *at, calibration);
  if (options.check && !job.problem.estimate_sigma_s && run.seed()) {
    if (options.on_progress) options.on_progress("checking the joint optimum with NLopt");
    report.check = check_joint(job, *run.seed(), *run.full());
  }
}

}  // namespace rangecal
