// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/landmarks_job.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <Eigen/Cholesky>
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <limits>

#include "calibrate/range_seed.hpp"
#include "calibrate/too_few.hpp"
#include "calibrate/walk_seed.hpp"
#include "in_parallel.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"
#include "rangecal/solvers/robust/robust.hpp"

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
  agreeing = problem;
  too_few = why_too_few(problem, options.order.value_or(1));
  if (options.noise_shape == NoiseShape::gaussian || too_few) return;
  rows = make_joint_problem(recordings, Grouping::rows);
  consensus = find_consensus(*rows);
  if (consensus.left_out > 0 && !why_too_few(consensus.problem, options.order.value_or(1)))
    agreeing = consensus.problem;
}

void LandmarksJob::take_all_readings() { agreeing = problem; }

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
  if (!agreeing.reads_bearings) {
    add([&] { return range_seed(agreeing, closed); });
  } else {
    add([&] { return closed_form_state(agreeing, closed); });
    if (is_walk(agreeing)) add([&] { return walk_seed(agreeing, order, law); });
    add([&] { return position_seed(agreeing, order, law); });
  }
  if (options.from && !candidates.empty()) {
    JointState state = candidates.back();
    const Calibration& from = *options.from;
    for (std::size_t l = 0; l < landmark_labels.size(); ++l)
      for (const LandmarkEstimate& landmark : from.landmarks)
        if (landmark.label == landmark_labels[l] && landmark.recording == problem.landmark_recording[l])
          state.landmarks[l] = landmark.position_m;
    add([&] {
      seed_curve_and_noise(agreeing, order, state);
      return state;
    });
    if (from.order() <= order) {
      state.alpha = Eigen::VectorXd::Zero(order + 1);
      state.alpha.head(from.alpha.size()) = from.alpha;
      if (from.noise.law == law) state.noise = from.noise;
      if (from.sigma_theta_rad && agreeing.reads_bearings)
        state.sigma_theta_rad = from.sigma_theta_rad->value;
      candidates.push_back(state);
    }
  }
  std::optional<JointState> best;
  double best_nll = infinity;
  for (JointState& state : candidates) {
    if (problem.estimate_sigma_s) state.sigma_s_m = default_sigma_s_m;
    const double nll = joint_nll(agreeing, state);
    if (nll < best_nll) {
      best_nll = nll;
      best = state;
    }
  }
  return best;
}

JointFit LandmarksJob::full(const JointState& start) const {
  const bool by_blocks = options.solver == JointSolver::block;
  const auto solved = [&](bool blocks) {
    return blocks ? solve_joint_block(agreeing, start) : solve_joint_ceres(agreeing, start);
  };
  JointFit fit = solved(by_blocks);
  if (fit.outcome != Outcome::not_converged) return fit;
  // If one solver fails the other may not: in Ceres's sums of squares rounding may hide what is left to gain, or a sigma that
  // goes to 0; the block solver's gradient is rounded where coordinates are far from the origin.
  JointFit other = solved(!by_blocks);
  return other.outcome == Outcome::not_converged && !(other.joint_nll < fit.joint_nll) ? fit : other;
}

MarginalOptions LandmarksJob::marginal_options() const {
  MarginalOptions marginal;
  marginal.estimate_sigma_s = problem.estimate_sigma_s;
  return marginal;
}

MarginalFit LandmarksJob::marginal(const JointState& start, const JointFit* full_fit,
                                   const MarginalFit* near) const {
  const MarginalOptions marginal = marginal_options();
  MarginalFit best;
  if (near) {
    JointState from = near->state;
    if (from.sigma_s_m) from.sigma_s_m = std::max(*from.sigma_s_m, no_sigma_s(problem));
    best = solve_marginal(agreeing, from, marginal);
  }
  if (best.outcome != Outcome::converged) best = marginal_by_joint(start, full_fit, marginal);
  // The joint likelihood may lead into another basin than the seed's, with a higher marginal NLL.
  const LaplaceValue at_seed = laplace_marginal(agreeing, start);
  const auto stands = [&](const MarginalFit& fit) {
    return fit.outcome == Outcome::converged && fit.marginal_nll <= at_seed.marginal_nll;
  };
  if (!at_seed.ok || best.outcome == Outcome::unobservable || stands(best)) return best;
  if (MarginalFit direct = solve_marginal(agreeing, start, marginal);
      stands(direct) && !(best.outcome == Outcome::converged && best.marginal_nll < direct.marginal_nll))
    return direct;
  // REML's sigmas do not minimise l_s, so the REML criterion decides which is lower.
  if (best.outcome == Outcome::converged && reml_at(best.state) > reml_at(start)) {
    best.outcome = Outcome::not_converged;
    best.reason = fmt::format("ended {:.2g} nats above its start", best.marginal_nll - at_seed.marginal_nll);
  }
  return best;
}

double LandmarksJob::reml_at(const JointState& state) const {
  MarginalOptions held;
  held.held.sigmas = true;
  const MarginalFit fit = solve_marginal(agreeing, state, held);
  if (fit.outcome != Outcome::converged || !fit.covariance) return infinity;
  const Eigen::Index n = state.alpha.size() + 2 * problem.landmark_count();
  const Eigen::LLT<Eigen::MatrixXd> factor(fit.covariance->topLeftCorner(n, n));
  return fit.marginal_nll - factor.matrixLLT().diagonal().array().log().sum();
}

MarginalFit LandmarksJob::marginal_by_joint(const JointState& start, const JointFit* full_fit,
                                            const MarginalOptions& marginal) const {
  MarginalFit best;
  if (full_fit && full_fit->outcome == Outcome::converged && !problem.estimate_sigma_s) {
    best = solve_marginal(agreeing, full_fit->state, marginal);
    if (best.outcome == Outcome::converged) return best;
  }
  JointState held_start = start;
  ClosedFormOptions closed;
  closed.order = static_cast<int>(start.alpha.size()) - 1;
  closed.noise_law = start.noise.law;
  if (problem.estimate_sigma_s) closed.bearings.sigma_s_m = default_sigma_s_m;
  const Calibration approximate = approximate_joint_calibration(agreeing, closed);
  if (is_usable(approximate.outcome) && approximate.noise.parameters.allFinite() &&
      approximate.noise.parameters.cwiseAbs().maxCoeff() > 0.0) {
    if (approximate.noise.law == start.noise.law) held_start.noise = approximate.noise;
    if (approximate.sigma_theta_rad && approximate.sigma_theta_rad->value > 0.0)
      held_start.sigma_theta_rad = approximate.sigma_theta_rad->value;
  }
  JointOptions held;
  held.held.sigmas = true;
  for (const JointState& from : {held_start, start}) {
    const JointFit fit = solve_joint_block(agreeing, from, held);
    if (!std::isfinite(fit.joint_nll)) continue;
    MarginalFit next = solve_marginal(agreeing, fit.state, marginal);
    if (next.outcome == Outcome::converged || next.outcome == Outcome::unobservable) return next;
    if (best.state.alpha.size() == 0 || next.marginal_nll < best.marginal_nll) best = next;
  }
  return best;
}

double LandmarksJob::parameters(const JointState& state) const { return parameter_count(problem, state); }

double parameter_count(const JointProblem& problem, const JointState& state, bool pairs) {
  const auto curve_and_noise = static_cast<double>(state.alpha.size() + state.noise.parameters.size());
  if (pairs) return curve_and_noise;
  return curve_and_noise + (problem.reads_bearings ? 1.0 : 0.0) + 2.0 * problem.landmark_count() +
         (problem.estimate_sigma_s ? 1.0 : 0.0);
}

JointState LandmarksJob::restated(const JointState& from, int order, NoiseLaw law) const {
  JointState state = from;
  const Cells& c = problem.cells;
  const Eigen::Index cells = static_cast<Eigen::Index>(c.size());
  Eigen::MatrixXd rows(cells, order + 1);
  Eigen::VectorXd curve(cells), distance(cells), spread(cells);
  for (Eigen::Index i = 0; i < cells; ++i) {
    const Pose2& pose = from.stops[c.stop[i]];
    const Eigen::Vector2d sight = from.landmarks[c.landmark[i]] - Eigen::Vector2d(pose.x_m, pose.y_m);
    distance[i] = sight.norm() - c.radius_m[i];
    curve[i] = evaluate_polynomial(from.alpha, distance[i]);
    spread[i] = from.noise.spread(distance[i], curve[i]);
    double power = 1.0 / spread[i];
    for (int j = 0; j <= order; ++j, power *= distance[i]) rows(i, j) = power;
  }
  if (order + 1 >= from.alpha.size()) {
    state.alpha = Eigen::VectorXd::Zero(order + 1);
    state.alpha.head(from.alpha.size()) = from.alpha;
  } else {
    state.alpha = rows.colPivHouseholderQr().solve(curve.cwiseQuotient(spread));
  }
  if (law == from.noise.law) return state;
  state.noise.law = law;
  state.noise.parameters = Eigen::VectorXd::Ones(1);
  if (!has_sigma(law)) {
    state.noise.parameters = Eigen::VectorXd::Zero(order + 1);
    state.noise.parameters[0] = 1.0;
  }
  double log_ratio = 0.0;
  for (Eigen::Index i = 0; i < cells; ++i)
    log_ratio += std::log(spread[i] / state.noise.spread(distance[i], curve[i])) / static_cast<double>(cells);
  state.noise.parameters *= std::exp(log_ratio);
  return state;
}

int LandmarksJob::highest_order() const {
  return std::min(options.max_order, static_cast<int>(problem.cells.size()) - 3);
}

void LandmarksJob::say_trying(const OrderAndLaw& model) const {
  if (options.on_progress)
    options.on_progress(
        fmt::format("trying order {} with noise law {}", model.first, to_string(model.second)));
}

SearchedModels LandmarksJob::choose_model(std::vector<ModelScore>& models,
                                          std::vector<TriedCurve>& curves) const {
  const int highest = highest_order();
  const OrderAndLaw start{options.order.value_or(std::clamp(highest, 1, 2)),
                          options.noise.value_or(NoiseLaw::f_squared)};
  SearchedModels searched{start.first, start.second, {}};
  if (options.order && options.noise) return searched;

  const MarginalFit* warm = nullptr;  // the likeliest so far
  double warm_aic = infinity;
  const auto fit_of = [&](const OrderAndLaw& model) {
    const auto [n, candidate] = model;
    MarginalFit fit;
    if (warm) {
      JointState begin = warm->state;
      begin.noise.law = candidate;
      seed_curve_and_noise(agreeing, n, begin);
      MarginalOptions enough = marginal_options();
      enough.gradient_tolerance = 1e-3;  // the stops are as far from their optimum: AIC to a thousandth
      enough.begin = warm->reml;
      fit = solve_marginal(agreeing, begin, enough);
    }
    if (fit.outcome != Outcome::converged)
      if (const auto begin = seed(n, candidate)) {
        const JointFit joint = problem.estimate_sigma_s ? JointFit{} : solve_joint_block(agreeing, *begin);
        fit = marginal(*begin, &joint);
      }
    return fit;
  };
  const auto keep = [&](const OrderAndLaw& model, MarginalFit ended) {
    const MarginalFit& fit = searched.fits.insert_or_assign(model, std::move(ended)).first->second;
    ModelScore tried{model.first, model.second, infinity, infinity};
    TriedCurve curve;
    if (fit.outcome == Outcome::converged) {
      tried.nll = fit.marginal_nll;
      tried.aic = 2.0 * (fit.marginal_nll + parameters(fit.state));
      curve.alpha = fit.state.alpha;
      if (fit.covariance) curve.covariance = fit.covariance->topLeftCorner(model.first + 1, model.first + 1);
      const bool has_sigma_s = !problem.estimate_sigma_s || !fit.state.sigma_s_m ||
                               *fit.state.sigma_s_m >= 10.0 * no_sigma_s(problem);
      if (has_sigma_s && tried.aic < warm_aic) warm = &fit, warm_aic = tried.aic;
    }
    curve.aic = tried.aic;
    curves.push_back(curve);
    models.push_back(tried);
    return tried.aic;
  };
  const auto values_of = [&](std::vector<OrderAndLaw> wanted) {
    std::vector<double> values;
    if (!warm) {  // the others start where it ends
      say_trying(wanted.front());
      values.push_back(keep(wanted.front(), fit_of(wanted.front())));
      wanted.erase(wanted.begin());
    }
    for (const OrderAndLaw& model : wanted) say_trying(model);
    std::vector<MarginalFit> fits(wanted.size());
    in_parallel(wanted.size(), [&](std::size_t i) { fits[i] = fit_of(wanted[i]); });
    for (std::size_t i = 0; i < wanted.size(); ++i) values.push_back(keep(wanted[i], std::move(fits[i])));
    return values;
  };
  std::map<OrderAndLaw, double> known;
  const OrderAndLaw best = search_model(options, highest, start, known, values_of);
  searched.order = options.order || std::isfinite(known.at(best)) ? best.first : 1;
  searched.law = best.second;
  return searched;
}

std::optional<RobustMarginalFit> LandmarksJob::choose_shapes(const JointState& start,
                                                             const std::optional<RemlSlopes>& reml,
                                                             std::vector<ModelScore>& models,
                                                             std::vector<TriedCurve>& curves) const {
  const MarginalOptions marginal = marginal_options();
  const bool automatic = options.noise_shape == NoiseShape::automatic;
  if (options.on_progress) options.on_progress("choosing the noise shapes");
  const bool is_given = options.order && options.noise;
  MarginalOptions begun = marginal;
  begun.begin = reml;
  const RobustMarginalFit best = solve_marginal_robust(*rows, start, options.noise_shape, begun, !is_given);
  if (best.shapes.range.shape == NoiseShape::gaussian && best.shapes.bearing.shape == NoiseShape::gaussian)
    return std::nullopt;
  if (is_given) return best;

  std::vector<ModelScore> tried_models;
  std::vector<TriedCurve> tried_curves;
  std::map<OrderAndLaw, RobustMarginalFit> fitted;
  RobustMarginalFit nearest = best;  // the likeliest so far
  const auto keep = [&](const OrderAndLaw& model, RobustMarginalFit fit) {
    const bool usable = is_usable(fit.fit.outcome);
    TriedCurve curve;
    curve.aic = usable ? fit.shapes.aic : infinity;
    curve.alpha = fit.fit.state.alpha;
    if (fit.fit.covariance)
      curve.covariance = fit.fit.covariance->topLeftCorner(model.first + 1, model.first + 1);
    tried_models.push_back({model.first, model.second, fit.shapes.nll, curve.aic});
    tried_curves.push_back(curve);
    if (usable && fit.shapes.aic < nearest.shapes.aic) nearest = fit;
    fitted.insert_or_assign(model, std::move(fit));
    return curve.aic;
  };
  const OrderAndLaw first(static_cast<int>(best.fit.state.alpha.size()) - 1, best.fit.state.noise.law);
  std::map<OrderAndLaw, double> known{{first, keep(first, best)}};
  const auto values_of = [&](const std::vector<OrderAndLaw>& wanted) {
    for (const OrderAndLaw& model : wanted) say_trying(model);
    std::vector<RobustMarginalFit> fits(wanted.size());
    in_parallel(wanted.size(), [&](std::size_t i) {
      const JointState begin = restated(nearest.fit.state, wanted[i].first, wanted[i].second);
      fits[i] = solve_marginal_robust(*rows, begin, nearest.shapes, marginal, true);
    });
    std::vector<double> values;
    for (std::size_t i = 0; i < wanted.size(); ++i) values.push_back(keep(wanted[i], std::move(fits[i])));
    return values;
  };
  const OrderAndLaw chosen = search_model(options, highest_order(), first, known, values_of);
  models = std::move(tried_models);
  curves = std::move(tried_curves);
  const RobustMarginalFit& rough = is_usable(fitted.at(chosen).fit.outcome) ? fitted.at(chosen) : best;
  // Heavy tails have several maxima: the one that the search carried along, and the one next to the Gaussian fit.
  constexpr double may_be_likelier = 10.0;  // AIC, of a fit that is settled roughly
  const bool as_begun = &rough == &best || chosen == first;
  RobustMarginalFit at, fresh;
  in_parallel(as_begun ? 1 : 2, [&](std::size_t i) {
    if (i == 0)
      at = solve_marginal_robust(*rows, rough.fit.state, rough.shapes, marginal);
    else
      fresh = solve_marginal_robust(*rows, restated(start, chosen.first, chosen.second),
                                    ChannelShapes(rough.shapes.range.shape, rough.shapes.bearing.shape),
                                    marginal, true);
  });
  const auto take_if_likelier = [&](RobustMarginalFit& other) {
    if (is_usable(other.fit.outcome) && other.shapes.aic < at.shapes.aic) at = std::move(other);
  };
  if (!as_begun && is_usable(fresh.fit.outcome) && fresh.shapes.aic < at.shapes.aic + may_be_likelier) {
    fresh = solve_marginal_robust(*rows, fresh.fit.state, fresh.shapes, marginal);
    take_if_likelier(fresh);
  }
  if (!as_begun && automatic) {  // a law chosen under the wrong family, or a family under the wrong law
    if (const auto other = better_shapes(*rows, at.fit.state, at.shapes)) {
      RobustMarginalFit again = solve_marginal_robust(*rows, at.fit.state, *other, marginal);
      take_if_likelier(again);
    }
  }
  at.shapes.range_tried = best.shapes.range_tried;
  at.shapes.bearing_tried = best.shapes.bearing_tried;
  return at;
}

}  // namespace rangecal
