// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/refit.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>

#include "diagnosis/rounds.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

std::vector<FreeParameter> free_parameters(const Rows& rows, const Projector& projector, const Model& model,
                                           int settled) {
  std::vector<FreeParameter> free;
  for (std::size_t e = 0; e < model.size(); ++e) {
    const auto& parameters = model[e].effect->info().parameters;
    const EffectKind kind = model[e].effect->info().kind;
    if (kind == EffectKind::grid || kind == EffectKind::label) continue;  // bookkeeping gave their values
    for (std::size_t j = 0; j < parameters.size(); ++j) {
      if (parameters[j].discrete) continue;
      FreeParameter parameter{static_cast<int>(e), static_cast<int>(j), FreeParameter::Acts::numeric};
      // At zero amplitude a period or a time constant has no slope; probe at the typical size.
      ActiveEffect probe = model[e];
      for (std::size_t a = 0; a < parameters.size(); ++a)
        if (parameters[a].linear && probe.parameters[a] == 0.0) probe.parameters[a] = parameters[a].typical;
      Eigen::VectorXd range, bearing;
      variance_signature(rows, projector.geometry(), probe, parameter.index, range, bearing);
      if (projector.raw_information(effect_signature(rows, projector, probe, parameter.index)) > 0.0)
        parameter.acts = FreeParameter::Acts::mean;
      else if (range.squaredNorm() + bearing.squaredNorm() > 0.0)
        parameter.acts = FreeParameter::Acts::variance;
      if (parameter.acts == FreeParameter::Acts::numeric && parameter.effect < settled) continue;
      free.push_back(parameter);
    }
  }
  return free;
}

double& value_of(Model& model, const FreeParameter& p) { return model[p.effect].parameters[p.index]; }

const EffectParameter& info_of(const Model& model, const FreeParameter& p) {
  return model[p.effect].effect->info().parameters[p.index];
}

std::pair<double, double> bounds_of(const Rows& rows, const Model& model, const FreeParameter& p) {
  return model[p.effect].effect->bounds(rows.context, static_cast<std::size_t>(p.index));
}

/// Score and information of log-variance slopes g: sum g (z^2 - 1) / 2 and sum g^2 / 2, the channel's mean
/// level, which the calibration's own sigma absorbs, taken out.
struct VarianceScore {
  Eigen::VectorXd range, bearing;  ///< centred slopes
};

VarianceScore centred(const Rows& rows, Eigen::VectorXd range, Eigen::VectorXd bearing) {
  range.array() -= range.mean();
  if (!rows.pairs) bearing.array() -= bearing.mean();
  return {std::move(range), std::move(bearing)};
}

/// One Gauss-Newton step for all mean and variance parameters; fills the covariance. False if nothing can
/// move.
bool newton_parameters(const Rows& rows, const WorkingProblem& working, const JointState& state,
                       const Model& model, const std::vector<FreeParameter>& free, Eigen::VectorXd& step,
                       Eigen::MatrixXd& covariance, double& promised) {
  const Projector projector(rows, working, state);
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  Eigen::VectorXd score = Eigen::VectorXd::Zero(n);
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  std::vector<Signature> signatures(n);
  std::vector<Eigen::VectorXd> projected(n);
  std::vector<VarianceScore> variance(n);
  // Squares of the corrected readings' residuals in units of their spreads, for variances.
  const Eigen::Index count = static_cast<Eigen::Index>(rows.size());
  Eigen::VectorXd range_z(count), bearing_z(count);
  const auto scale_of = [](const Whitening& whitening, Eigen::Index i) {
    return whitening.scale.size() > 0 ? whitening.scale[i] : 1.0;
  };
  for (Eigen::Index i = 0; i < count; ++i) {
    const double range = working.range[i] - projector.geometry().f[rows.cell[i]];
    range_z[i] =
        std::pow(range * scale_of(working.range_whitening, i), 2) * projector.row_range_information[i];
    bearing_z[i] = std::pow(working.bearing[i] * scale_of(working.bearing_whitening, i), 2) *
                   projector.row_bearing_information[i];
  }
  for (Eigen::Index a = 0; a < n; ++a) {
    const ActiveEffect& active = model[free[a].effect];
    if (free[a].acts == FreeParameter::Acts::mean) {
      signatures[a] = effect_signature(rows, projector, active, free[a].index);
      projected[a] = projector.project(signatures[a]);
      score[a] = projector.score(signatures[a]);
    } else if (free[a].acts == FreeParameter::Acts::variance) {
      Eigen::VectorXd range, bearing;
      variance_signature(rows, projector.geometry(), active, free[a].index, range, bearing);
      variance[a] = centred(rows, range, bearing);
      score[a] =
          0.5 * (variance[a].range.dot(range_z) + (rows.pairs ? 0.0 : variance[a].bearing.dot(bearing_z)));
    }
  }
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b <= a; ++b) {
      if (free[a].acts != free[b].acts) continue;
      if (free[a].acts == FreeParameter::Acts::mean)
        information(a, b) = projector.inner(signatures[a], projected[b], signatures[b]);
      else if (free[a].acts == FreeParameter::Acts::variance)
        information(a, b) =
            0.5 * (variance[a].range.dot(variance[b].range) + variance[a].bearing.dot(variance[b].bearing));
      information(b, a) = information(a, b);
    }
    const double scale = std::max(info_of(model, free[a]).typical, 1e-12);
    // A very wide prior (1000 typical sizes) keeps a direction that the calibration absorbs from running
    // away.
    information(a, a) += 1e-6 / (scale * scale);
  }
  Eigen::VectorXd diagonal = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd scaled =
      diagonal.asDiagonal() * information * diagonal.asDiagonal() + 1e-9 * Eigen::MatrixXd::Identity(n, n);
  const Eigen::LLT<Eigen::MatrixXd> factor(scaled);
  if (factor.info() != Eigen::Success) return false;
  step = diagonal.cwiseProduct(factor.solve(diagonal.cwiseProduct(score)));
  covariance = diagonal.asDiagonal() * factor.solve(Eigen::MatrixXd::Identity(n, n)) * diagonal.asDiagonal();
  promised = 0.5 * score.dot(step);
  return step.allFinite();
}

/// Coordinates that are not free follow the model's commanded poses: exact ones, and those of stops that
/// share the position error of the stop that opened their place.
void follow_commanded(const std::vector<StopPrior>& priors, std::vector<Pose2>& stops) {
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const StopPrior& prior = priors[k];
    if (prior.sigma_heading_rad == 0.0) stops[k].heading_rad = prior.commanded.heading_rad;
    if (!prior.opens_place || prior.sigma_xy_m > 0.0) continue;
    stops[k].x_m = prior.commanded.x_m;
    stops[k].y_m = prior.commanded.y_m;
  }
  share_places(priors, stops);
}

}  // namespace

namespace {

double prior_nll(const Rows& rows, const Eigen::VectorXd& alpha) {
  if (!rows.alpha_prior || rows.alpha_prior->exact()) return 0.0;
  const Eigen::VectorXd off = alpha - rows.alpha_prior->mean;
  return 0.5 * off.dot(rows.alpha_prior->precision * off);
}

/// Moves alpha by a Gauss-Newton step towards its optimum under the prior; returns the nats it promises.
double step_alpha(const Rows& rows, const WorkingProblem& working, JointState& state) {
  const Projector projector(rows, working, state);
  const Eigen::Index alphas = state.alpha.size();
  const AlphaPrior& prior = *rows.alpha_prior;
  const Eigen::VectorXd gradient =
      projector.system().reduced_gradient().head(alphas) + prior.precision * (state.alpha - prior.mean);
  const Eigen::VectorXd step = -projector.phi_covariance().topLeftCorner(alphas, alphas) * gradient;
  state.alpha += step;
  return -0.5 * gradient.dot(step);
}

}  // namespace

double calibrate_under(const Rows& rows, const Model& model, JointState& state, const RefitOptions& options,
                       MarginalFit* detail) {
  MarginalOptions marginal;
  marginal.held = options.held;
  marginal.held.alpha = marginal.held.alpha || rows.alpha_prior.has_value();
  marginal.held.landmarks = marginal.held.landmarks || rows.pairs;
  marginal.gradient_tolerance = 1e-4;
  double value = infinity, least = infinity;
  JointState least_state = state;
  Rounds rounds(model, options.places_stay);
  do {
    const WorkingProblem working = rounds.begin(rows, model, state);
    JointState start = state;
    follow_commanded(working.problem.stops, start.stops);
    MarginalFit fit = solve_marginal(working.problem, start, marginal);
    if (!std::isfinite(fit.marginal_nll) || fit.outcome == Outcome::failed) return infinity;
    // Alpha under a simulation's prior: held at each solve, moved in between while that gains.
    double fit_value = fit.marginal_nll + prior_nll(rows, fit.state.alpha);
    for (int move = 0; move < 3 && rows.alpha_prior && !rows.alpha_prior->exact(); ++move) {
      JointState moved = fit.state;
      if (!(step_alpha(rows, working, moved) > 1e-3)) break;
      MarginalFit next = solve_marginal(working.problem, moved, marginal);
      const double next_value = next.marginal_nll + prior_nll(rows, next.state.alpha);
      if (next.outcome == Outcome::failed || !(next_value < fit_value)) break;
      fit_value = next_value;
      fit = std::move(next);
    }
    state = fit.state;
    value = fit_value + working.constant;
    if (rounds.bends())  // the solve saw straight lines; the value is that of the effects where it ended
      value +=
          joint_nll(working_problem(rows, model, state).problem, state) - joint_nll(working.problem, state);
    if (rounds.bends() && !(value < least)) continue;
    least = value;
    least_state = state;
    if (detail) *detail = std::move(fit);
  } while (rounds.another(rows, model, state, value));
  if (!rounds.bends()) return value;
  state = std::move(least_state);
  return least;
}

namespace {

/// Searches one parameter that only the value of the likelihood knows, by steps that shrink: a factor `reach`
/// first for one that is positive, else its typical size.
void search_line(const Rows& rows, const FreeParameter& p, const RefitOptions& options, double reach,
                 Fit& fit) {
  RefitOptions staying = options;  // tails and dependence move no place by much
  staying.places_stay = true;
  const EffectParameter& info = info_of(fit.model, p);
  double best = value_of(fit.model, p);
  const bool positive = info.low >= 0.0;
  double spread = positive ? reach : (reach - 1.0) * std::max(std::abs(info.typical), 1e-9);
  for (int pass = 0; pass < 6; ++pass, spread = positive ? std::sqrt(spread) : 0.5 * spread) {
    if (positive && best <= 0.0) best = info.typical;
    bool moved = true;
    for (int hop = 0; moved && hop < 4; ++hop) {
      moved = false;
      for (int side : {-1, 1}) {
        const double x = positive ? best * std::pow(spread, side) : best + side * spread;
        if (x < info.low || x > info.high) continue;
        JointState state = fit.state;
        Model trial = fit.model;
        value_of(trial, p) = x;
        const double value = calibrate_under(rows, trial, state, staying);
        if (value < fit.nll - 1e-6) {
          fit.nll = value;
          fit.state = state;
          best = x;
          value_of(fit.model, p) = x;
          moved = true;
          break;
        }
      }
    }
  }
}

}  // namespace

Fit refit(const Rows& rows, const Model& start_model, const JointState& start, const RefitOptions& options) {
  Fit fit;
  fit.model = start_model;
  fit.state = start;
  {
    const WorkingProblem working = working_problem(rows, {}, start);
    const Projector projector(rows, working, start);
    fit.free = free_parameters(rows, projector, start_model, options.settled);
  }
  MarginalFit detail;
  fit.nll = calibrate_under(rows, fit.model, fit.state, options, &detail);
  if (!std::isfinite(fit.nll)) return fit;
  const Eigen::Index n = static_cast<Eigen::Index>(fit.free.size());
  fit.covariance = Eigen::MatrixXd::Zero(n, n);

  // Line searches first: they set the scale of everything else. Where there are several they depend on one
  // another.
  const auto numeric = std::count_if(fit.free.begin(), fit.free.end(), [](const FreeParameter& p) {
    return p.acts == FreeParameter::Acts::numeric;
  });
  for (int sweep = 0; sweep < (numeric > 1 ? 2 : 1); ++sweep)
    for (const FreeParameter& p : fit.free)
      if (p.acts == FreeParameter::Acts::numeric) search_line(rows, p, options, sweep == 0 ? 2.0 : 1.2, fit);

  bool searched = numeric > 0;  // since `detail` was told
  double damping = 1.0;
  for (int iteration = 0; iteration < options.max_iterations && n > 0; ++iteration) {
    const WorkingProblem working = working_problem(rows, fit.model, fit.state);
    Eigen::VectorXd step;
    double promised = 0.0;
    if (!newton_parameters(rows, working, fit.state, fit.model, fit.free, step, fit.covariance, promised))
      break;
    if (promised < 1e-3) break;
    bool accepted = false;
    for (int attempt = 0; attempt < 5; ++attempt, damping *= 0.4) {
      Model trial = fit.model;
      for (Eigen::Index a = 0; a < n; ++a) {
        if (fit.free[a].acts == FreeParameter::Acts::numeric) continue;
        const EffectParameter& info = info_of(trial, fit.free[a]);
        const auto [low, high] = bounds_of(rows, trial, fit.free[a]);
        // A non-linear parameter moves by at most a third of its bounds at a time.
        const double limit = info.linear ? infinity : 0.33 * (high - low);
        double& value = value_of(trial, fit.free[a]);
        value = std::clamp(value + std::clamp(damping * step[a], -limit, limit), low, high);
      }
      JointState state = fit.state;
      MarginalFit trial_detail;
      const double value = calibrate_under(rows, trial, state, options, &trial_detail);
      if (value < fit.nll + 1e-7) {
        accepted = fit.nll - value > 1e-3;
        fit.model = trial;
        fit.state = state;
        fit.nll = value;
        detail = trial_detail;
        searched = false;
        damping = std::min(1.0, 2.5 * damping);
        break;
      }
    }
    if (!accepted) break;
  }
  if (searched) {
    JointState state = fit.state;
    calibrate_under(rows, fit.model, state, options, &detail);
  }
  fit.outcome = detail.outcome;
  const int alphas = static_cast<int>(fit.state.alpha.size());
  if (detail.covariance) {
    fit.alpha_covariance = detail.covariance->topLeftCorner(alphas, alphas);
    const int tau =
        static_cast<int>(detail.covariance->rows()) - 1 - static_cast<int>(fit.state.noise.parameters.size());
    fit.noise_std = std::sqrt((*detail.covariance)(tau, tau));
    fit.sigma_theta_std = fit.state.sigma_theta_rad * std::sqrt(detail.covariance->diagonal().tail(1)[0]);
  }
  if (rows.alpha_prior) {
    fit.alpha_covariance = Eigen::MatrixXd::Zero(alphas, alphas);
    const WorkingProblem working = working_problem(rows, fit.model, fit.state);
    if (!rows.alpha_prior->exact())
      fit.alpha_covariance =
          Projector(rows, working, fit.state).phi_covariance().topLeftCorner(alphas, alphas);
  }
  fit.ok = true;
  return fit;
}

}  // namespace rangecal::diagnosis
