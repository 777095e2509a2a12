// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/covariance/cramer_rao.hpp"

#include <Eigen/Geometry>
#include <map>

#include "rangecal/core/random.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

JointSystem system_for(const JointProblem& problem, const JointState& state) {
  return JointSystem(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()));
}

}  // namespace

std::optional<Eigen::MatrixXd> cramer_rao_bound(const JointProblem& problem, const JointState& state) {
  JointSystem system = system_for(problem, state);
  if (!std::isfinite(system.assemble(state, HessianKind::fisher)) || !system.eliminate()) return std::nullopt;
  return scaled_inverse(system.schur());
}

std::vector<Pose2> draw_stops(const JointProblem& problem, const JointState& state, std::uint64_t seed) {
  Random random(seed);
  std::vector<Pose2> stops(problem.stops.size());
  std::map<int, Eigen::Vector2d> place_error;
  for (int k = 0; k < problem.stop_count(); ++k) {
    const StopPrior& prior = problem.stops[k];
    const double sigma = sigma_xy_of(problem, state, k);
    const double unit_y = random.normal(), unit_x = random.normal(), unit_heading = random.normal();
    const Eigen::Vector3d drawn = stop_error(prior, sigma, {unit_x, unit_y, unit_heading});
    const Eigen::Vector2d error = drawn.head<2>();
    const double turn = drawn.z();
    const Eigen::Vector2d commanded(prior.commanded.x_m, prior.commanded.y_m);
    Eigen::Vector2d position;
    double heading = prior.commanded.heading_rad + turn;
    if (prior.chained) {
      const StopPrior& before = problem.stops[k - 1];
      const Eigen::Vector2d step = commanded - Eigen::Vector2d(before.commanded.x_m, before.commanded.y_m);
      const double turned =
          prior.turns_add_up ? stops[k - 1].heading_rad - before.commanded.heading_rad : 0.0;
      const double frame = prior.turns_add_up ? stops[k - 1].heading_rad : 0.0;
      heading += turned;
      const Eigen::Vector2d from(stops[k - 1].x_m, stops[k - 1].y_m);
      const Eigen::Vector2d slip = prior.opens_place ? error : Eigen::Vector2d::Zero().eval();
      position = from + Eigen::Rotation2Dd(turned) * step + Eigen::Rotation2Dd(frame) * slip;
    } else {
      if (prior.opens_place) place_error[prior.place] = error;
      position = commanded + place_error[prior.place];
    }
    stops[k] = {position.x(), position.y(), heading};
  }
  return stops;
}

std::optional<Eigen::MatrixXd> hybrid_cramer_rao_bound(const JointProblem& problem, const JointState& state,
                                                       int draws, std::uint64_t seed) {
  JointSystem mean = system_for(problem, state), draw = system_for(problem, state);
  mean.clear();
  JointState at = state;
  int used = 0;
  for (int i = 0; i < draws; ++i) {
    at.stops = draw_stops(problem, state, seed_from("hybrid bound", {seed, static_cast<std::uint64_t>(i)}));
    if (!std::isfinite(draw.assemble(at, HessianKind::fisher))) continue;
    mean.accumulate(draw, 1.0);
    ++used;
  }
  if (used == 0) return std::nullopt;
  JointSystem scaled = system_for(problem, state);
  scaled.clear();
  scaled.accumulate(mean, 1.0 / used);
  if (!scaled.eliminate()) return std::nullopt;
  return scaled_inverse(scaled.schur());
}

}  // namespace rangecal
