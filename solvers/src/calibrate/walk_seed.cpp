// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/walk_seed.hpp"

#include <algorithm>
#include <string>

#include "joint_ml/seed_from.hpp"
#include "kalman/landmark_filter.hpp"

namespace rangecal {

JointState walk_seed(const JointProblem& problem, int order, NoiseLaw law) {
  const double scale = mean_range(problem);
  Calibration line;
  line.alpha = Eigen::Vector2d(0.0, 1.0);
  line.alpha_covariance = Eigen::Vector2d(0.01 * scale * scale, 0.01).asDiagonal();
  line.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.03 * scale)};
  line.sigma_theta_rad = Estimate{0.02, std::nullopt};
  LandmarkFilter filter(line);
  JointState state;
  state.noise.law = law;
  const Cells& c = problem.cells;
  for (std::size_t k = 0; k < problem.stops.size(); ++k) {
    const StopPrior& prior = problem.stops[k];
    filter.start(prior.commanded, covariance_of(prior, prior.sigma_xy_m), prior.chained, !prior.opens_place);
    for (auto i = static_cast<std::size_t>(c.stop_begin[k]);
         i < static_cast<std::size_t>(c.stop_begin[k + 1]); ++i)
      filter.take(std::to_string(c.landmark[i]), c.radius_m[i], c.range_mean[i], c.bearing_mean[i]);
    const Eigen::Vector3d pose = filter.x.segment<3>(filter.pose());
    state.stops.push_back({pose[0], pose[1], pose[2]});
  }
  for (std::size_t k = state.stops.size(); k-- > 1;) {  // a place is known best from its last stop
    const StopPrior &own = problem.stops[k], &before = problem.stops[k - 1];
    if (own.place != before.place) continue;
    state.stops[k - 1].x_m = state.stops[k].x_m + before.commanded.x_m - own.commanded.x_m;
    state.stops[k - 1].y_m = state.stops[k].y_m + before.commanded.y_m - own.commanded.y_m;
  }
  share_places(problem.stops, state.stops);
  state.landmarks.assign(problem.landmark_radius_m.size(), Eigen::Vector2d::Zero());
  for (std::size_t l = 0; l < filter.labels.size(); ++l)
    state.landmarks[std::stoul(filter.labels[l])] =
        filter.x.segment<2>(filter.pose() + 3 + 2 * static_cast<Eigen::Index>(l));
  seed_from_places(problem, order, state);
  return state;
}

bool is_walk(const JointProblem& problem) {
  return std::any_of(problem.stops.begin(), problem.stops.end(),
                     [](const StopPrior& stop) { return stop.chained; });
}

}  // namespace rangecal
