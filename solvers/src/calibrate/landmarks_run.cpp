// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "calibrate/landmark_influence.hpp"
#include "calibrate/left_out_check.hpp"
#include "calibrate/noise_shapes.hpp"
#include "calibrate/observability.hpp"
#include "calibrate/walk_seed.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/calibrate/plausibility.hpp"
#include "rangecal/solvers/nlopt/joint_check.hpp"

namespace rangecal {
namespace {

/// A marginal fit, Gaussian or not, and what its stops say of it.
struct Judged {
  MarginalFit fit;
  std::optional<StopInfluence> influence;
};

/// What `use` makes of the readings as the noise shapes of a fit weigh them.
template <typename Use>
auto of_weighed(const LandmarksJob& job, const JointState& state, const RobustShapes* shapes,
                const Use& use) {
  return shapes ? use(weighted_problem(*job.rows, state, shapes->range, shapes->bearing)) : use(job.problem);
}

Judged judged(const LandmarksJob& job, const MarginalFit& fit, const RobustShapes* shapes) {
  Judged result{fit, std::nullopt};
  JointState& state = result.fit.state;
  if (fit.outcome != Outcome::converged || !fit.covariance) return result;
  if (state.sigma_s_m) state.sigma_s_m = std::max(*state.sigma_s_m, no_sigma_s(job.problem));
  result.influence = of_weighed(job, state, shapes, [&](const JointProblem& problem) {
    return stop_influence(problem, state, *fit.covariance);
  });
  return result;
}

/// The parts of a job that several methods share, each solved when first asked for.
class Run {
 public:
  /// `shaped`: the marginal fit with the noise shapes that all methods share; none: Gaussian noise. `near`: a fit of the model to
  /// start from, which must outlive this; or null.
  Run(const LandmarksJob& job, int of_order, NoiseLaw of_law, std::optional<RobustMarginalFit> shaped,
      const MarginalFit* near)
      : order(of_order),
        law(of_law),
        job_(job),
        shaped_(std::move(shaped)),
        near_(near),
        seed_(job.seed(of_order, of_law)) {
    if (shaped_) keep(shaped_->fit);
  }

  const int order;
  const NoiseLaw law;
  const std::optional<JointState>& seed() const { return seed_; }
  const RobustMarginalFit* shaped() const { return shaped_ ? &*shaped_ : nullptr; }
  const RobustShapes* shapes() const { return shaped_ ? &shaped_->shapes : nullptr; }
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
      if (near_) marginal_ = job_.marginal(*seed_, nullptr, near_);
      if (!near_ || marginal_->outcome != Outcome::converged) marginal_ = job_.marginal(*seed_, full());
      keep(*marginal_);
    }
    return marginal_ ? &*marginal_ : nullptr;
  }

  /// The marginal fit, with the noise shapes where there are any, judged; it has no influence where there is no fit.
  const Judged& judgement() {
    if (!judged_) {
      const MarginalFit* fit = shaped_ ? &shaped_->fit : marginal();
      judged_ = fit ? judged(job_, *fit, shapes()) : Judged{};
    }
    return *judged_;
  }
  /// The marginal fit is solved already.
  bool has_marginal() const { return shaped_ || marginal_; }

 private:
  void keep(const MarginalFit& fit) {
    if (fit.state.alpha.size() == 0 || !std::isfinite(fit.joint_nll)) return;
    best_state = fit.state;
    if (best_state->sigma_s_m)
      best_state->sigma_s_m = std::max(*best_state->sigma_s_m, no_sigma_s(job_.problem));
  }

  const LandmarksJob& job_;
  std::optional<RobustMarginalFit> shaped_;
  const MarginalFit* near_;
  std::optional<JointState> seed_;
  std::optional<JointFit> full_;
  std::optional<MarginalFit> marginal_;
  std::optional<Judged> judged_;
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

/// A joint maximum of which a sigma is far below marginal's is spurious: the stops fit some readings exactly.
void refuse_spurious(const JointState& marginal, JointFit& fit) {
  constexpr double far_below = 0.4;  // what it should lack for the stops fitted is some ten per cent
  if (!is_usable(fit.outcome) || fit.state.noise.law != marginal.noise.law) return;
  const double theta = fit.state.sigma_theta_rad / marginal.sigma_theta_rad,
               noise = fit.state.noise.parameters.norm() / marginal.noise.parameters.norm();
  if (!(std::min(theta, noise) < far_below)) return;
  fit.outcome = Outcome::unbounded;
  fit.reason = fmt::format(
      "the joint likelihood has no maximum of use: it falls along {}, here {:.2g} of what marginal finds, where the stops "
      "fit as many readings exactly as they have free coordinates; use the marginal method",
      theta < noise ? "sigma_theta" : "sigma_e", std::min(theta, noise));
}

/// The joint maximum with the shapes that `marginal` found, held: with the scale of a mixture free it has no maximum of
/// use, for the stops can fit half of the readings exactly while the mixture takes the rest.
Calibration full_with_shapes(const LandmarksJob& job, const RobustMarginalFit& shaped) {
  RobustJointFit fit = solve_joint_with_shapes(*job.rows, shaped.fit.state, shaped.shapes);
  refuse_spurious(shaped.fit.state, fit.fit);
  return calibration_from_robust(job, fit);
}

Calibration by_full(const LandmarksJob& job, Run& run) {
  if (job.problem.estimate_sigma_s)
    return named(
        job, Method::full, Outcome::unbounded,
        "with sigma_xy_m: estimate the joint likelihood has no maximum: sigma_s goes to 0; use marginal");
  if (const RobustMarginalFit* shaped = run.shaped()) return full_with_shapes(job, *shaped);
  const JointFit* fit = run.full();
  if (!fit) return named(job, Method::full, Outcome::failed, "no start inside the model's domain was found");
  JointFit refused = *fit;
  if (const MarginalFit* marginal = run.marginal(); marginal && marginal->outcome == Outcome::converged)
    refuse_spurious(marginal->state, refused);
  return calibration_from_fit(job, Method::full, refused);
}

Calibration by_marginal(const LandmarksJob& job, Run& run) {
  if (const RobustMarginalFit* shaped = run.shaped()) return calibration_from_robust(job, *shaped);
  if (!run.seed())
    return named(job, Method::marginal, Outcome::failed, "no start inside the model's domain was found");
  const MarginalFit& fit = *run.marginal();
  Calibration result = calibration_from_fit(job, Method::marginal, fit);
  result.sigma_s_upper95_m = fit.sigma_s_upper95_m;
  return result;
}

Calibration by_method(const LandmarksJob& job, Method method, Run& run) {
  switch (method) {
    case Method::closed_form:
    case Method::approximate:
      return calibration_by_closed_form(job, method, run.order, run.law);
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

/// A run of a lower order than that of `run`, AIC's, if one predicts the readings of stops left out better. A curve bends after an
/// effect of another variable, and AIC, which takes readings for independent, lets it.
std::optional<Run> run_of_lower_order(const LandmarksJob& job, Run& run, const SearchedModels& searched,
                                      CalibrationReport& report) {
  if (job.options.order || run.order < 2 || !job.problem.reads_bearings) return std::nullopt;
  const MarginalOptions marginal = job.marginal_options();
  const RobustMarginalFit* shaped = run.shaped();
  struct AtOrder {
    std::optional<RobustMarginalFit> shaped;
    Judged judged;
  };
  std::vector<AtOrder> at(static_cast<std::size_t>(run.order));  // orders 1 to run.order
  in_parallel(at.size(), [&](std::size_t i) {
    const int n = static_cast<int>(i) + 1;
    if (n == run.order && (run.has_marginal() || !searched.at(n, run.law))) {
      at[i].judged = run.judgement();
    } else if (shaped) {
      const JointState start = job.restated(shaped->fit.state, n, run.law);
      at[i].shaped = solve_marginal_robust(*job.rows, start, shaped->shapes, marginal, true);
      at[i].judged = judged(job, at[i].shaped->fit, &at[i].shaped->shapes);
    } else if (const MarginalFit* fitted = searched.at(n, run.law)) {
      at[i].judged = judged(job, *fitted, nullptr);
    } else {
      at[i].judged = Run(job, n, run.law, std::nullopt, nullptr).judgement();
    }
  });
  const Judged& highest = at.back().judged;
  if (!highest.influence) return std::nullopt;
  const JointProblem judge =
      shaped ? weighted_problem(*job.rows, shaped->fit.state, shaped->shapes.range, shaped->shapes.bearing)
             : job.agreeing;
  const ReferenceDistances reference(judge, highest.fit.state);
  LeftOutErrors of_best =
      left_out_errors(judge, reference, highest.fit.state, *highest.influence, highest.fit.state);
  std::optional<int> best;
  for (int n = run.order - 1; n >= 1; --n) {
    const Judged& lower = at[static_cast<std::size_t>(n) - 1].judged;
    if (!lower.influence) continue;
    const LeftOutErrors errors =
        left_out_errors(judge, reference, lower.fit.state, *lower.influence, highest.fit.state);
    if (!predicts_better(errors, of_best)) continue;
    best = n;
    of_best = errors;
  }
  if (!best) return std::nullopt;
  report.notes.push_back(fmt::format(
      "order {} rather than {}, which has the lowest AIC: it predicts the readings of stops left out better",
      *best, run.order));
  std::optional<RobustMarginalFit> settled;
  if (shaped) {
    const RobustMarginalFit& rough = *at[static_cast<std::size_t>(*best) - 1].shaped;
    settled = solve_marginal_robust(*job.rows, rough.fit.state, rough.shapes, marginal);
    settled->shapes.range_tried = shaped->shapes.range_tried;
    settled->shapes.bearing_tried = shaped->shapes.bearing_tried;
  }
  return std::optional<Run>(std::in_place, job, *best, run.law, std::move(settled),
                            searched.at(*best, run.law));
}

/// Standard deviations by stops, and by how much the model's fall short of them and of those by landmarks.
void add_deviations(const StopInfluence* by_stops, const LandmarkInfluence* by_landmarks,
                    Calibration& calibration) {
  const Eigen::Index alphas = calibration.alpha.size();
  if (by_stops) {
    calibration.alpha_covariance_by_stops = by_stops->covariance.topLeftCorner(alphas, alphas);
    for (std::size_t l = 0; l < calibration.landmarks.size(); ++l) {
      const Eigen::Index at = alphas + 2 * static_cast<Eigen::Index>(l);
      calibration.landmarks[l].covariance_by_stops = by_stops->covariance.block<2, 2>(at, at);
    }
  }
  if (by_landmarks) calibration.alpha_covariance_by_landmarks = by_landmarks->covariance();
  calibration.misfit = misfit_of(calibration, by_stops, by_landmarks);
}

/// Those, and whether the curve is better than none.
void add_checks(const LandmarksJob& job, const Judged& at, const RobustShapes* shapes,
                Calibration& calibration) {
  if (calibration.outcome != Outcome::converged || !at.fit.covariance) return;
  const JointState& state = at.fit.state;
  const auto by_landmarks = of_weighed(job, state, shapes, [&](const JointProblem& problem) {
    return landmark_influence(problem, job.landmark_labels, state, *at.fit.covariance);
  });
  add_deviations(at.influence ? &*at.influence : nullptr, by_landmarks ? &*by_landmarks : nullptr,
                 calibration);
  if (!at.influence || !job.problem.reads_bearings) return;
  const LeftOutErrors errors =
      left_out_errors(job.agreeing, ReferenceDistances(job.agreeing, state), state, *at.influence, state);
  calibration.left_out =
      left_out_check(errors, &*at.influence, is_walk(job.problem) ? "stretches of the walk" : "stops");
}

/// What the shapes that were tried cost against the ones kept.
void note_tried(const RobustShapes& shapes, CalibrationReport& report) {
  if (shapes.range_tried.empty() && shapes.bearing_tried.empty()) return;
  report.notes.push_back(fmt::format("noise shapes by AIC: of ranges {}, of bearings {}",
                                     tried_in_words(shapes.range.shape, shapes.range_tried),
                                     tried_in_words(shapes.bearing.shape, shapes.bearing_tried)));
}

/// Throws InputError for options that landmarks do not have.
void check_landmark_options(std::span<const Recording> recordings, const CalibrateOptions& options) {
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

/// Marks the calibrations of every method whose curve the recording does not determine, and those of the closed form.
void mark_unobservable_curves(const LandmarksJob& job, const std::optional<JointState>& at,
                              CalibrationReport& report) {
  if (const auto reason = at ? unobservable_reason(job.problem, *at) : std::nullopt)
    for (Calibration& calibration : report.calibrations)
      mark_unobservable(job.problem, *reason, *at, calibration);
  for (Calibration& calibration : report.calibrations) {
    if (calibration.outcome != Outcome::unobservable || calibration.alpha.size() > 0) continue;
    if (at)
      mark_unobservable(job.problem, std::string(calibration.reason), *at, calibration);
    else
      calibration.outcome = Outcome::failed;
  }
}

/// True where no reading is a gross outlier and Gaussian noise predicts stops left out better than the shapes that were chosen for their
/// AIC: these bend the curve after an effect that the model lacks. Where standard deviations by stops say that the model does not
/// hold, AIC is no reason for a shape, and Gaussian noise may be worse by the standard error.
bool gaussian_predicts_better(const LandmarksJob& job, Run& gaussian, const RobustMarginalFit& shaped) {
  if (job.consensus.left_out > 0 || !job.problem.reads_bearings) return false;
  const Judged& plain = gaussian.judgement();
  const Judged other = judged(job, shaped.fit, &shaped.shapes);
  if (!plain.influence || !other.influence) return false;
  const JointState &of_plain = plain.fit.state, &of_other = other.fit.state;
  const ReferenceDistances reference(job.agreeing, of_plain);
  const std::optional<Gain> gain =
      gain_of(left_out_errors(job.agreeing, reference, of_plain, *plain.influence, of_plain),
              left_out_errors(job.agreeing, reference, of_other, *other.influence, of_plain));
  if (!gain) return false;
  Calibration with_shapes = calibration_from_robust(job, shaped);
  add_deviations(&*other.influence, nullptr, with_shapes);
  const bool holds = !with_shapes.misfit || with_shapes.misfit->holds();
  return gain->mean > (holds ? 0.0 : -gain->std_dev);
}

/// The noise shapes asked for, from the optimum of Gaussian noise on the readings that agree; none: Gaussian. `run` gets what was
/// solved on the way to that optimum.
std::optional<RobustMarginalFit> shapes_at(const LandmarksJob& job, CalibrationReport& report,
                                           std::vector<TriedCurve>& curves, const SearchedModels& searched,
                                           std::optional<Run>& run) {
  if (!job.rows) return std::nullopt;
  Run& gaussian =
      run.emplace(job, searched.order, searched.law, std::nullopt, searched.at(searched.order, searched.law));
  if (!gaussian.seed()) return std::nullopt;
  const MarginalFit* fit = gaussian.marginal();
  std::vector<ModelScore> models = report.models;
  std::vector<TriedCurve> shaped_curves = curves;
  std::optional<RobustMarginalFit> shaped =
      job.choose_shapes(gaussian.best_state ? *gaussian.best_state : *gaussian.seed(),
                        fit ? fit->reml : std::nullopt, models, shaped_curves);
  if (shaped && fit && job.options.noise_shape == NoiseShape::automatic &&
      gaussian_predicts_better(job, gaussian, *shaped)) {
    report.notes.push_back(fmt::format(
        "gaussian noise rather than {} of ranges and {} of bearings, which have the lower AIC: they predict the readings of "
        "stops left out no better, and no reading is a gross outlier",
        to_string(shaped->shapes.range.shape), to_string(shaped->shapes.bearing.shape)));
    shaped.reset();
  }
  if (shaped) {
    report.models = std::move(models);
    curves = std::move(shaped_curves);
  }
  return shaped;
}

}  // namespace

void calibrate_landmarks(std::span<const Recording> recordings, const CalibrateOptions& options,
                         CalibrationReport& report) {
  check_landmark_options(recordings, options);
  LandmarksJob job(recordings, options, report);
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
  SearchedModels searched = job.choose_model(report.models, curves);
  std::optional<Run> run;  // of the model chosen
  std::optional<RobustMarginalFit> shaped = shapes_at(job, report, curves, searched, run);
  if (shaped) {
    const int order = static_cast<int>(shaped->fit.state.alpha.size()) - 1;
    const NoiseLaw law = shaped->fit.state.noise.law;
    run.emplace(job, order, law, std::move(shaped), nullptr);
  } else if (job.consensus.left_out > 0) {  // Gaussian noise holds them all
    run.reset();
    job.take_all_readings();
    report.models.clear();
    curves.clear();
    searched = job.choose_model(report.models, curves);
  }
  if (!run)
    run.emplace(job, searched.order, searched.law, std::nullopt, searched.at(searched.order, searched.law));
  if (std::optional<Run> lower = run_of_lower_order(job, *run, searched, report))
    run.emplace(std::move(*lower));
  for (Method method : methods) {
    if (options.on_progress) options.on_progress(fmt::format("solving {}", to_string(method)));
    if (options.on_method) options.on_method(method, true);
    report.calibrations.push_back(by_method(job, method, *run));
    if (options.on_method) options.on_method(method, false);
  }
  std::optional<double> sigma_s, sigma_theta;
  for (const Calibration& calibration : report.calibrations) {
    if (calibration.sigma_s_m) sigma_s = calibration.sigma_s_m->value;
    if (calibration.sigma_theta_rad) sigma_theta = calibration.sigma_theta_rad->value;
  }
  for (Calibration& calibration : report.calibrations)
    score(job, sigma_s, sigma_theta, run->shapes(), calibration);
  for (Calibration& calibration : report.calibrations)
    if (calibration.method == Method::marginal)  // the others' curves at other orders are not known
      calibration.covariance_with_choice = covariance_with_choice(calibration, curves);
  for (Calibration& calibration : report.calibrations) {
    if (calibration.method != Method::marginal) continue;
    if (run->shaped()) list_outliers(job, *run->shaped(), calibration);
    add_checks(job, run->judgement(), run->shapes(), calibration);
  }
  report_shapes(report);
  if (run->shapes()) note_tried(*run->shapes(), report);
  mark_unobservable_curves(job, run->best_state ? run->best_state : run->seed(), report);
  if (options.check && !run->shapes() && !job.problem.estimate_sigma_s && run->seed()) {
    if (options.on_progress) options.on_progress("checking the joint optimum with NLopt");
    report.check = checked(job, *run->seed(), *run->full());
  }
}

}  // namespace rangecal
