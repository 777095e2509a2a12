// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/joint_ml/robust.hpp"

#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>

#include "joint_ml/blocks.hpp"
#include "joint_ml/collapse.hpp"
#include "joint_ml/newton_step.hpp"
#include "joint_ml/robust_covariance.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"

namespace rangecal {
namespace {

constexpr int max_rounds = 300;

/// Standardised errors of one channel, and sum log s.
struct Channel {
  std::vector<double> z;
  double log_spread = 0.0;

  double nll(const NoiseShapeParameters& shape) const {
    double sum = log_spread;
    for (double e : z) sum -= log_density(shape, e).value;
    return sum;
  }
  /// sum w z^2 with given weights.
  double squares(const std::vector<double>& weights) const {
    double sum = 0.0;
    for (std::size_t i = 0; i < z.size(); ++i) sum += weights[i] * z[i] * z[i];
    return sum;
  }
};

struct Residuals {
  Residuals(const JointProblem& problem, const JointState& state) {
    const Cells& c = problem.cells;
    for (std::size_t i = 0; i < c.size(); ++i) {
      const Sight sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]);
      const double f = evaluate_polynomial(state.alpha, sight.d), s = state.noise.spread(sight.d, f);
      range.z.push_back((c.range_mean[i] - f - c.bent(i, sight.d)) / s);
      range.log_spread += std::log(s);
      bearing.z.push_back(wrap_angle(c.bearing_mean[i] - sight.bearing) / state.sigma_theta_rad);
    }
    bearing.log_spread = static_cast<double>(c.size()) * std::log(state.sigma_theta_rad);
  }
  Channel range, bearing;
};

/// The shape's parameters that go with given z: nu by Brent on log nu, (p, k) by one step of their own EM. `fitted`: how
/// many parameters the sigma allows for, N - sum w z^2 (REML; 0 for the joint maximum). nu then allows for them too,
/// since their information (nu + 1) / (nu + 3) / s^2 per reading moves with both: 1/2 log det of it.
void renew_shape(const Channel& channel, double fitted, NoiseShapeParameters& shape) {
  if (shape.shape == NoiseShape::student_t) {
    const auto cost = [&](double log_nu) {
      NoiseShapeParameters trial = shape;
      trial.nu = std::exp(log_nu);
      const ShapeDensity density_at(trial);
      double sum = 0.5 * fitted * std::log((trial.nu + 1.0) / (trial.nu + 3.0));
      for (double e : channel.z) sum -= density_at(e).value;
      return sum;
    };
    const double low = std::log(NoiseShapeParameters::nu_min), high = std::log(NoiseShapeParameters::nu_max);
    shape.nu = std::exp(boost::math::tools::brent_find_minima(cost, low, high, 24).first);
  } else if (shape.shape == NoiseShape::contaminated) {
    const double k_sq = shape.outlier_scale * shape.outlier_scale;
    double share = 0.0, square = 0.0;
    for (double e : channel.z) {  // w = 1 - r + r / k^2, r the probability of an outlier
      const double r = (1.0 - log_density(shape, e).weight) / (1.0 - 1.0 / k_sq);
      share += r;
      square += r * e * e;
    }
    const double n = static_cast<double>(channel.z.size());
    if (share > 0.0)
      shape.outlier_scale = std::clamp(std::sqrt(square / share), NoiseShapeParameters::scale_min,
                                       NoiseShapeParameters::scale_max);
    shape.outlier_share = std::clamp(share / n, 1e-6, 0.49);
  }
}

void require_rows(const JointProblem& rows) {
  for (double count : rows.cells.count)
    if (count != 1.0)
      throw InputError("robust noise shapes need every reading as a cell of its own (Grouping::rows)");
}

void set_weights(const Residuals& residuals, const NoiseShapeParameters& range,
                 const NoiseShapeParameters& bearing, Cells& cells) {
  for (std::size_t i = 0; i < cells.size(); ++i) {
    cells.range_weight[i] = log_density(range, residuals.range.z[i]).weight;
    cells.bearing_weight[i] = log_density(bearing, residuals.bearing.z[i]).weight;
  }
}

double laplace_part(const JointFit&) { return 0.0; }
double laplace_part(const MarginalFit& fit) { return fit.marginal_nll - fit.joint_nll; }
/// Its sigmas and nu are not those of the lowest likelihood but REML's.
constexpr bool is_restricted(const JointFit&) { return false; }
constexpr bool is_restricted(const MarginalFit&) { return true; }

/// Covariance and standard deviations of the shapes delivered.
void fill_shape_deviations(const JointProblem& rows, bool restricted, JointFit& fit, RobustShapes& shapes) {
  const Residuals residuals(rows, fit.state);
  JointProblem weighted = rows;
  set_weights(residuals, shapes.range, shapes.bearing, weighted.cells);
  ShapeAtEstimate range{shapes.range, residuals.range.squares(weighted.cells.range_weight), {}};
  ShapeAtEstimate bearing{shapes.bearing, residuals.bearing.squares(weighted.cells.bearing_weight), {}};
  set_robust_covariance(weighted, restricted, range, bearing, fit);
  shapes.range_std = range.shape_std;
  shapes.bearing_std = bearing.shape_std;
}

int free_count(const JointProblem& problem, const JointState& state, const Held& held, bool sigma_s) {
  const JointLayout layout(problem, static_cast<int>(state.alpha.size()),
                           static_cast<int>(state.noise.parameters.size()), sigma_s);
  return static_cast<int>(free_globals(layout, held).size());
}

template <typename Robust, typename Solve>
Robust one_shape(const JointProblem& rows, const JointState& start, NoiseShape shape, int parameters,
                 const Solve& solve) {
  Robust best;
  NoiseShapeParameters range, bearing;
  range.shape = bearing.shape = shape;
  JointProblem weighted = rows;
  JointState at = start;
  double last = std::numeric_limits<double>::infinity();
  int rounds = 0;
  for (; rounds < max_rounds; ++rounds) {
    if (shape != NoiseShape::gaussian) {
      const Residuals residuals(rows, at);
      if (rounds > 0) {
        const double n = static_cast<double>(rows.cells.size());
        const auto fitted = [&](const Channel& channel, const std::vector<double>& weights) {
          return is_restricted(best.fit) ? std::max(0.0, n - channel.squares(weights)) : 0.0;
        };
        renew_shape(residuals.range, fitted(residuals.range, weighted.cells.range_weight), range);
        renew_shape(residuals.bearing, fitted(residuals.bearing, weighted.cells.bearing_weight), bearing);
      }
      set_weights(residuals, range, bearing, weighted.cells);
    }
    auto fit = solve(weighted, at);
    const bool usable = std::isfinite(fit.joint_nll) && fit.outcome != Outcome::failed;
    const Residuals residuals(rows, fit.state);
    const JointNllParts parts = joint_nll_parts(rows, fit.state);
    const double nll = usable ? residuals.range.nll(range) + residuals.bearing.nll(bearing) + parts.stops +
                                    parts.taped + laplace_part(fit)
                              : std::numeric_limits<double>::infinity();
    // REML's fixed point lies a little above the lowest likelihood: there the rounds end where it stands still.
    const bool restricted = is_restricted(fit), gains = nll < last;
    if (gains || rounds == 0 || (restricted && usable)) {
      best.fit = fit;
      best.shapes.range = range;
      best.shapes.bearing = bearing;
      best.shapes.nll = nll;
    }
    // EM creeps at its end: a thousandth of this is far below any standard deviation.
    const double change = restricted ? std::abs(last - nll) : last - nll;
    if (!usable || shape == NoiseShape::gaussian || !(change > 1e-7)) break;
    last = nll;
    at = fit.state;
  }
  best.shapes.rounds = std::min(rounds + 1, max_rounds);
  if (shape != NoiseShape::gaussian)
    fill_shape_deviations(rows, is_restricted(best.fit), best.fit, best.shapes);
  if (const std::string collapsed = collapsed_sigma(start, best.fit.state); !collapsed.empty()) {
    best.fit.outcome = Outcome::unbounded;
    best.fit.reason = "with this noise shape the likelihood has no maximum: " + collapsed;
  } else if (rounds == max_rounds && best.fit.outcome == Outcome::converged) {
    best.fit.outcome = Outcome::not_converged;
    best.fit.reason = "the weights of the noise shape did not settle";
  }
  best.shapes.aic = 2.0 * (best.shapes.nll + parameters + 2 * shape_parameter_count(shape));
  return best;
}

template <typename Robust, typename Solve>
Robust robust(const JointProblem& rows, const JointState& start, NoiseShape shape, int parameters,
              const Solve& solve) {
  require_rows(rows);
  // The Gaussian fit is the start of the others: all see the same basin.
  Robust best = one_shape<Robust>(rows, start, NoiseShape::gaussian, parameters, solve);
  if (shape == NoiseShape::gaussian) {
    best.shapes.tried = {{shape, best.shapes.aic}};
    return best;
  }
  const JointState from = is_usable(best.fit.outcome) ? best.fit.state : start;
  const bool any = shape == NoiseShape::automatic;
  std::vector<std::pair<NoiseShape, double>> tried;
  if (any) tried.emplace_back(NoiseShape::gaussian, best.shapes.aic);
  for (NoiseShape one : {NoiseShape::student_t, NoiseShape::contaminated}) {
    if (!any && one != shape) continue;
    Robust fit = one_shape<Robust>(rows, from, one, parameters, solve);
    tried.emplace_back(one, fit.shapes.aic);
    if (!any || (is_usable(fit.fit.outcome) && fit.shapes.aic < best.shapes.aic)) best = std::move(fit);
  }
  best.shapes.tried = tried;
  return best;
}

}  // namespace

RobustJointFit solve_joint_robust(const JointProblem& rows, const JointState& start, NoiseShape shape,
                                  const JointOptions& options) {
  return robust<RobustJointFit>(rows, start, shape, free_count(rows, start, options.held, false),
                                [&](const JointProblem& weighted, const JointState& at) {
                                  return solve_joint_block(weighted, at, options);
                                });
}

RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start, NoiseShape shape,
                                        const MarginalOptions& options) {
  return robust<RobustMarginalFit>(rows, start, shape,
                                   free_count(rows, start, options.held, options.estimate_sigma_s),
                                   [&](const JointProblem& weighted, const JointState& at) {
                                     return solve_marginal(weighted, at, options);
                                   });
}

RobustNll robust_nll(const JointProblem& rows, const JointState& state, const NoiseShapeParameters& range,
                     const NoiseShapeParameters& bearing) {
  require_rows(rows);
  RobustNll out;
  const JointNllParts parts = joint_nll_parts(rows, state);
  if (!std::isfinite(parts.total())) return out;
  const Residuals residuals(rows, state);
  JointProblem weighted = rows;
  set_weights(residuals, range, bearing, weighted.cells);
  const LaplaceValue laplace = laplace_marginal(weighted, state);
  out.ok = laplace.ok;
  out.joint = residuals.range.nll(range) + residuals.bearing.nll(bearing) + parts.stops + parts.taped;
  out.marginal = out.joint + laplace.marginal_nll - laplace.joint_nll;
  return out;
}

}  // namespace rangecal
