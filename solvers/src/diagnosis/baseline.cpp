// SPDX-License-Identifier: BSD-3-Clause
#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <iterator>
#include <limits>
#include <optional>
#include <set>
#include <vector>

#include "calibrate/range_seed.hpp"
#include "calibrate/walk_seed.hpp"
#include "diagnosis/grids.hpp"
#include "diagnosis/search.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// Distances at a resolution below which two of them do not tell a coefficient apart.
int distinct_distances(const Rows& rows, const JointState& state) {
  std::set<long> seen;
  for (double d : cell_geometry(rows, state).d) seen.insert(std::lround(d / 0.02));
  return static_cast<int>(seen.size());
}

/// Landmarks placed from where the stops were meant to be; along a random walk from where its readings put
/// them, if that is more likely.
JointState start_from_readings(const JointProblem& problem, int order, NoiseLaw law) {
  if (!problem.reads_bearings) {
    ClosedFormOptions options;
    options.order = order;
    options.noise_law = law;
    return range_seed(problem, options);
  }
  JointState state = position_seed(problem, order, law);
  if (!is_walk(problem)) return state;
  try {
    JointState walked = walk_seed(problem, order, law);
    if (joint_nll(problem, walked) < joint_nll(problem, state)) state = std::move(walked);
  } catch (const InputError&) {  // the walk cannot be followed; the commanded path is all there is
  }
  return state;
}

/// `state`, or, where its curve is not positive at some distance (drifted odometry or outliers bent it), with the curve f(d) = d and the
/// spread about that.
JointState with_positive_curve(const Rows& rows, JointState state) {
  const CellGeometry geometry = cell_geometry(rows, state);
  const bool positive = std::all_of(geometry.f.begin(), geometry.f.end(), [](double f) { return f > 0.0; });
  if (positive || state.alpha.size() < 2) return state;
  state.alpha.setZero();
  state.alpha[1] = 1.0;
  state.noise.parameters.setOnes();
  std::vector<double> errors;
  for (std::size_t c = 0; c < geometry.d.size(); ++c) {
    const double d = geometry.d[c];
    errors.push_back((rows.problem.cells.range_mean[c] - d) / state.noise.spread(d, d));
  }
  state.noise.parameters[0] = std::max(robust_spread(std::move(errors)), 1e-6);
  return state;
}

JointState start_of(const Rows& rows, int order, NoiseLaw law) {
  if (!rows.pairs) return with_positive_curve(rows, start_from_readings(rows.problem, order, law));
  JointState state;
  state.noise.law = law;
  state.landmarks = {Eigen::Vector2d::Zero()};
  for (const StopPrior& prior : rows.problem.stops) state.stops.push_back(prior.commanded);
  seed_curve_and_noise(rows.problem, std::min(order, rows.cell_count - 1), state);
  state.sigma_theta_rad = SilentBearing::sigma_theta_rad;
  return state;
}

/// Noise of another law and about the same level over the cells.
Noise with_law(const CellGeometry& geometry, NoiseLaw law) {
  Noise noise{law, Eigen::VectorXd::Ones(1)};
  double log_ratio = 0.0;
  for (std::size_t c = 0; c < geometry.d.size(); ++c)
    log_ratio += std::log(geometry.spread[c] / noise.spread(geometry.d[c], geometry.f[c]));
  noise.parameters[0] = std::exp(log_ratio / static_cast<double>(geometry.d.size()));
  return noise;
}

}  // namespace

Fit fit_baseline(const Rows& rows, const DiagnoseOptions& options, RefitOptions& refit_options,
                 const Model& grids, std::optional<NoiseLaw> law) {
  Fit best;
  if (options.simulation) {
    const Calibration& given = *options.simulation;
    JointState state = start_of(rows, static_cast<int>(given.alpha.size()) - 1, given.noise.law);
    state.alpha = given.alpha;
    state.noise = given.noise;
    if (given.sigma_theta_rad && rows.reads_bearings()) state.sigma_theta_rad = given.sigma_theta_rad->value;
    best = refit(rows, {}, state, refit_options);
    if (!best.ok) throw NoAnswerError("the simulation's calibration cannot be applied to this recording");
    return best;
  }
  const int distances = distinct_distances(rows, start_of(rows, 1, NoiseLaw::f_squared));
  // One distance less than would leave nothing to judge by, but for two, which show a line and no more.
  const int order = distances == 2 ? 1 : std::clamp(distances - 2, 0, rows.curve.order);
  std::vector<NoiseLaw> laws(std::begin(triangulation_first), std::end(triangulation_first));
  if (law)
    laws = {*law};
  else if (const std::optional<Noise> noise = noise_within_cells(rows, grids))
    laws = {noise->law};
  for (const NoiseLaw one : laws) {
    JointState state = start_of(rows, order, one);
    JointOptions full_options;
    full_options.held.landmarks = rows.pairs;
    const JointFit full = solve_joint_block(rows.problem, state, full_options);
    if (full.outcome == Outcome::converged) state = full.state;
    Fit fit = refit(rows, {}, state, refit_options);
    if (fit.ok && (!best.ok || fit.nll < best.nll - law_margin)) best = fit;
  }
  if (!best.ok)
    throw NoAnswerError("the seed model cannot be fitted to this recording; run calibrate to see why");
  return best;
}

Model without_law(Model model) {
  std::erase_if(model, [](const ActiveEffect& a) {
    return a.effect->info().channel == "range_noise" && a.effect->info().covariate == "range";
  });
  return model;
}

std::optional<NoiseLaw> law_beside(const Rows& rows, const Fit& fit, const DiagnoseOptions& options,
                                   const RefitOptions& refit_options) {
  if (options.simulation || fit.model.empty()) return std::nullopt;
  const Model model = without_law(fit.model);
  std::optional<NoiseLaw> due;
  if (const std::optional<Noise> noise = noise_within_cells(rows, model, &fit.state)) {
    due = noise->law;
  } else {
    const CellGeometry geometry = cell_geometry(rows, fit.state);
    double least = std::numeric_limits<double>::infinity();
    for (const NoiseLaw law : triangulation_first) {
      JointState state = fit.state;
      if (law != state.noise.law) state.noise = with_law(geometry, law);
      const Fit other = refit(rows, model, state, refit_options);
      if (!other.ok || !(other.nll < least - law_margin)) continue;
      least = other.nll;
      due = law;
    }
  }
  return due == fit.state.noise.law ? std::nullopt : due;
}

}  // namespace rangecal::diagnosis
