// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/marginal_score.hpp"

#include <cmath>
#include <utility>

#include "marginal/laplace.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

/// Adds cell i of `all`, as one of stop `stop`.
void add_cell(const Cells& all, std::size_t i, int stop, JointProblem& part) {
  Cells& c = part.cells;
  c.stop.push_back(stop);
  c.landmark.push_back(all.landmark[i]);
  c.count.push_back(all.count[i]);
  c.range_weight.push_back(all.range_weight[i]);
  c.bearing_weight.push_back(all.bearing_weight[i]);
  c.range_mean.push_back(all.range_mean[i]);
  c.range_mean_square.push_back(all.range_mean_square[i]);
  c.bearing_mean.push_back(all.bearing_mean[i]);
  c.bearing_mean_square.push_back(all.bearing_mean_square[i]);
  c.radius_m.push_back(all.radius_m[i]);
  part.readings += all.count[i];
}

}  // namespace

std::optional<MarginalScore> marginal_score(const JointProblem& problem, JointState state, bool sigma_s_free,
                                            bool settled) {
  JointSystem system(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()), sigma_s_free);
  int evaluations = 0;
  if (!settled && !std::isfinite(settle_stops(system, state, evaluations))) return std::nullopt;
  if (settled && (!std::isfinite(system.assemble(state, HessianKind::exact)) || !system.eliminate()))
    return std::nullopt;
  MarginalScore score{system.reduced_gradient() + system.log_det_gradient(state), system.schur()};
  const int sigmas = system.layout().sigma_count();
  score.hessian.bottomRightCorner(sigmas, sigmas) += system.log_det_sigma_hessian(state);
  return score;
}

JointProblem part_of(const JointProblem& problem, const std::vector<int>& stops) {
  JointProblem part;
  part.landmark_radius_m = problem.landmark_radius_m;
  part.landmark_recording = problem.landmark_recording;
  part.estimate_sigma_s = problem.estimate_sigma_s;
  const Cells& all = problem.cells;
  part.cells.stop_begin.push_back(0);
  int last_place = -1;
  for (const int k : stops) {
    StopPrior prior = problem.stops[k];
    if (prior.place != std::exchange(last_place, prior.place)) ++part.place_count;
    prior.place = part.place_count - 1;
    part.stops.push_back(prior);
    part.sigma_s_shared.push_back(problem.sigma_s_shared[k]);
    for (int i = all.stop_begin[k]; i < all.stop_begin[k + 1]; ++i)
      add_cell(all, static_cast<std::size_t>(i), part.stop_count() - 1, part);
    part.cells.stop_begin.push_back(static_cast<int>(part.cells.size()));
  }
  return part;
}

JointProblem without_landmarks(const JointProblem& problem, const std::vector<char>& left_out) {
  JointProblem rest = problem;
  rest.cells = {};
  rest.readings = 0.0;
  std::erase_if(rest.known_distances, [&](const KnownDistance& distance) {
    return left_out[distance.from] || left_out[distance.to];
  });
  const Cells& all = problem.cells;
  rest.cells.stop_begin.push_back(0);
  for (int k = 0; k < problem.stop_count(); ++k) {
    for (int i = all.stop_begin[k]; i < all.stop_begin[k + 1]; ++i)
      if (!left_out[all.landmark[i]]) add_cell(all, static_cast<std::size_t>(i), k, rest);
    rest.cells.stop_begin.push_back(static_cast<int>(rest.cells.size()));
  }
  return rest;
}

}  // namespace rangecal
