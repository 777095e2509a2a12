// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/refit_step.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/likeliest_sequence.hpp"
#include "diagnosis/tail_slopes.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

/// Score and information of log-variance slopes g: sum g (z^2 - 1) / 2 and sum g^2 / 2, the channel's mean
/// level, which the calibration's own sigma absorbs, taken out.
struct VarianceScore {
  Eigen::VectorXd range, bearing;  ///< centred slopes
};

VarianceScore centred(const Rows& rows, Eigen::VectorXd range, Eigen::VectorXd bearing) {
  range.array() -= range.mean();
  if (rows.reads_bearings()) bearing.array() -= bearing.mean();
  return {std::move(range), std::move(bearing)};
}

/// Squares of the corrected readings' residuals in units of their spreads.
struct ResidualSquares {
  Eigen::VectorXd range, bearing;
};

ResidualSquares residual_squares(const Rows& rows, const WorkingProblem& working,
                                 const Projector& projector) {
  const Eigen::Index count = static_cast<Eigen::Index>(rows.size());
  ResidualSquares squares{Eigen::VectorXd(count), Eigen::VectorXd(count)};
  for (Eigen::Index i = 0; i < count; ++i) {
    const double range = working.range[i] - projector.geometry().f[rows.cell[i]];
    squares.range[i] =
        std::pow(range * working.range_whitening.scale_of(i), 2) * projector.row_range_information[i];
    if (working.tail_square.size() > 0) squares.range[i] += working.tail_square[i];
    squares.bearing[i] = std::pow(working.bearing[i] * working.bearing_whitening.scale_of(i), 2) *
                         projector.row_bearing_information[i];
  }
  return squares;
}

/// What each parameter does to the readings, and the slope of the likelihood along it.
struct ParameterSlopes {
  std::vector<Signature> signatures;
  std::vector<Eigen::VectorXd> projected;
  std::vector<VarianceScore> variance;
  Eigen::VectorXd score;
};

ParameterSlopes parameter_slopes(const Rows& rows, const WorkingProblem& working, const Projector& projector,
                                 const Model& model, const std::vector<FreeParameter>& free) {
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  ParameterSlopes slopes{std::vector<Signature>(n), std::vector<Eigen::VectorXd>(n),
                         std::vector<VarianceScore>(n), Eigen::VectorXd::Zero(n)};
  const ResidualSquares squares = residual_squares(rows, working, projector);
  for (Eigen::Index a = 0; a < n; ++a) {
    const ActiveEffect& active = model[free[a].effect];
    if (free[a].acts == FreeParameter::Acts::mean) {
      slopes.signatures[a] = effect_signature(rows, projector, active, free[a].index);
      slopes.projected[a] = projector.project(slopes.signatures[a]);
      slopes.score[a] = projector.score(slopes.signatures[a]);
    } else if (free[a].acts == FreeParameter::Acts::variance) {
      Eigen::VectorXd range, bearing;
      variance_signature(rows, projector.geometry(), active, free[a].index, range, bearing);
      VarianceScore& own = slopes.variance[a] = centred(rows, range, bearing);
      slopes.score[a] = 0.5 * (own.range.dot(squares.range) +
                               (rows.reads_bearings() ? own.bearing.dot(squares.bearing) : 0.0));
    }
  }
  return slopes;
}

Eigen::MatrixXd information_of(const Projector& projector, const Model& model,
                               const std::vector<FreeParameter>& free, const ParameterSlopes& slopes) {
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  const std::vector<VarianceScore>& variance = slopes.variance;
  for (Eigen::Index a = 0; a < n; ++a) {
    for (Eigen::Index b = 0; b <= a; ++b) {
      if (free[a].acts != free[b].acts) continue;
      if (free[a].acts == FreeParameter::Acts::mean)
        information(a, b) = projector.inner(slopes.signatures[a], slopes.projected[b], slopes.signatures[b]);
      else if (free[a].acts == FreeParameter::Acts::variance)
        information(a, b) =
            0.5 * (variance[a].range.dot(variance[b].range) + variance[a].bearing.dot(variance[b].bearing));
      information(b, a) = information(a, b);
    }
    const double scale = size_of(info_of(model, free[a]));
    // A very wide prior (1000 typical sizes) keeps a direction that the calibration absorbs from running
    // away.
    information(a, a) += 1e-6 / (scale * scale);
  }
  return information;
}

}  // namespace

std::optional<ParameterStep> newton_parameters(const Rows& rows, const WorkingProblem& working,
                                               const Projector& projector, const Model& model,
                                               const std::vector<FreeParameter>& free) {
  const Eigen::Index n = static_cast<Eigen::Index>(free.size());
  ParameterSlopes slopes = parameter_slopes(rows, working, projector, model, free);
  const Eigen::MatrixXd information = information_of(projector, model, free, slopes);
  const Eigen::VectorXd diagonal = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::MatrixXd one = Eigen::MatrixXd::Identity(n, n);
  Eigen::MatrixXd scaled = diagonal.asDiagonal() * information * diagonal.asDiagonal();
  const Eigen::LLT<Eigen::MatrixXd> factor(scaled + 1e-9 * one);
  if (factor.info() != Eigen::Success) return std::nullopt;
  ParameterStep step;
  step.covariance = diagonal.asDiagonal() * factor.solve(one) * diagonal.asDiagonal();
  for (Eigen::Index a = 0; a < n; ++a)
    if (is_stuck(rows, model, free[a], slopes.score[a])) hold(a, slopes.score, scaled);
  step.parameters = diagonal.cwiseProduct(
      Eigen::LLT<Eigen::MatrixXd>(scaled + 1e-9 * one).solve(diagonal.cwiseProduct(slopes.score)));
  if (!step.parameters.allFinite()) return std::nullopt;
  step.predicted_gain = 0.5 * slopes.score.dot(step.parameters);
  step.signatures = std::move(slopes.signatures);
  return step;
}

void search_line(const Rows& rows, const FreeParameter& p, const RefitOptions& options, double reach,
                 Fit& fit) {
  constexpr int most_hops = 6, most_refinements = 4;
  constexpr double next_to_nothing = 2e-3;  // gain that a parabola predicts [nats]
  RefitOptions staying = options;           // tails and dependence move no place by much
  staying.places_stay = true;
  const EffectParameter& info = info_of(fit.model, p);
  const auto [low, high] = bounds_of(rows, fit.model, p);
  const bool positive = low >= 0.0;
  const double unit = size_of(info);
  // u: the parameter in typical sizes, in its logarithm where it is positive.
  const auto u_of = [&](double x) { return positive ? std::log(x / unit) : x / unit; };
  const double lowest = u_of(low), highest = u_of(high), narrow = positive ? 0.02 : 0.01;
  struct Point {
    double u, nll;
  };
  SolverLog log("line search");
  if (log.on()) log.of(info.name);
  int tried = 0;
  const auto at = [&](double u) -> Point {
    JointState state = fit.state;
    Model trial = fit.model;
    ++tried;
    value_of(trial, p) = unit * (positive ? std::exp(u) : u);
    const double nll = calibrate_under(rows, trial, state, staying);
    log.iteration(tried, nll, not_known, not_known);
    if (nll < fit.nll - 1e-6) {
      fit.nll = nll;
      fit.state = std::move(state);
      fit.model = std::move(trial);
    }
    return {u, nll};
  };
  const double start = value_of(fit.model, p);
  Point best = positive && start <= 0.0 ? at(0.0) : Point{u_of(start), fit.nll};
  double hop = positive ? std::log(reach) : reach - 1.0;
  // Outwards by hops that double, until both neighbours are worse than `best`.
  Point below = at(std::max(best.u - hop, lowest)), above = below;
  if (below.nll < best.nll) {
    above = best;
    best = below;
    for (int n = 0; n < most_hops && best.u > lowest; ++n) {
      below = at(std::max(best.u - (hop *= 2.0), lowest));
      if (!(below.nll < best.nll)) break;
      above = best;
      best = below;
    }
  } else {
    above = at(std::min(best.u + hop, highest));
    for (int n = 0; n < most_hops && above.nll < best.nll; ++n) {
      below = best;
      best = above;
      if (best.u >= highest) break;
      above = at(std::min(best.u + (hop *= 2.0), highest));
    }
  }
  // To the vertex of the parabola through the three, not closer to the middle than a tenth of the way.
  for (int n = 0; n < most_refinements && above.u - below.u > narrow; ++n) {
    const double left = best.u - below.u, right = above.u - best.u;
    const double down = (below.nll - best.nll) / std::max(left, 1e-12),
                 up = (above.nll - best.nll) / std::max(right, 1e-12);
    const bool wider_right = right > left;
    double move = wider_right ? 0.38 * right : -0.38 * left;
    if (left > 0.0 && right > 0.0 && std::isfinite(down) && std::isfinite(up) && down + up > 0.0) {
      const double vertex = 0.5 * (down * right - up * left) / (down + up);
      if (vertex * vertex * (down + up) / (left + right) < next_to_nothing) break;
      const double least = 0.1 * (vertex > 0.0 ? right : left);
      move = std::copysign(std::max(std::abs(vertex), least), vertex);
    }
    const Point moved = at(best.u + move);
    if (moved.nll < best.nll) {
      (move > 0.0 ? below : above) = best;
      best = moved;
    } else {
      (move > 0.0 ? above : below) = moved;
    }
  }
  log.end(tried, fit.nll, "the rest is next to nothing, or too far");
}

void fit_tails(const Rows& rows, const RefitOptions& options, Fit& fit) {
  constexpr int most_alternations = 12;
  constexpr double settled = 0.01;  // nats
  RefitOptions staying = options;   // tails move no place by much
  staying.places_stay = true;
  std::vector<FreeParameter> tails;
  for (const FreeParameter& p : fit.free)
    if (is_of_tail(fit.model, p)) tails.push_back(p);
  for (int alternation = 0; alternation < most_alternations; ++alternation) {
    const double before = fit.nll;
    const Model from = fit.model, to = likeliest_tails(rows, fit, tails);
    for (const double length : {1.0, 0.25, 0.0}) {  // the spread alone follows the weights at last
      Model trial = from;
      for (const FreeParameter& p : tails)
        value_of(trial, p) = std::pow(value_of(trial, p), 1.0 - length) *
                             std::pow(to[static_cast<std::size_t>(p.effect)].parameters[p.index], length);
      JointState state = fit.state;
      const double value = calibrate_under(rows, trial, state, staying);
      if (!(value < fit.nll)) continue;
      fit.nll = value;
      fit.state = std::move(state);
      fit.model = std::move(trial);
      break;
    }
    if (!(before - fit.nll > settled)) return;
  }
}

void fit_sequence(const Rows& rows, const RefitOptions& options, Fit& fit) {
  constexpr int most_iterations = 6;
  constexpr double settled = 0.01;  // nats
  RefitOptions staying = options;
  staying.places_stay = true;
  const SolverLog log("sequence");
  for (int iteration = 0; iteration < most_iterations; ++iteration) {
    auto likeliest =
        likeliest_sequence(rows, fit.free, fit.model, working_problem(rows, fit.model, fit.state), fit.state);
    if (!likeliest) return;
    auto& [trial, state] = *likeliest;
    const double value = calibrate_under(rows, trial, state, staying);
    log.iteration(iteration + 1, std::min(value, fit.nll), not_known, not_known);
    if (!(value < fit.nll)) return;
    const double gain = fit.nll - value;
    fit.nll = value;
    fit.model = std::move(trial);
    fit.state = std::move(state);
    if (gain < settled) return;
  }
}

}  // namespace rangecal::diagnosis
