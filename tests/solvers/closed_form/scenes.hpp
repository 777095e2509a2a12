// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal::closed_form_tests {

/// A 2021 setting: stops on a gentle arc, landmarks around it.
struct BearingScene {
  std::vector<Eigen::Vector2d> landmarks{{1.0, 2.0}, {2.5, -1.5}, {4.0, 1.2}, {0.5, -2.0}, {3.0, 3.0}};
  int stops = 20, repeats = 1;
  double radius = 0.12, sigma_theta = 0.0, sigma_s = 0.0, sigma_e = 0.0;  ///< noise sigma_e f^2
  Eigen::VectorXd alpha{{0.0525, 0.8838, 0.0584}};
  bool straight = false;
  bool walk = false;  ///< the errors of the stops add up
};

inline Recording record(const BearingScene& scene, std::uint64_t seed) {
  Random random(seed);
  Recording recording;
  recording.sigma_xy_m = scene.sigma_s;
  if (scene.walk) recording.stop_error = StopErrorModel::random_walk;
  Eigen::Vector2d error = Eigen::Vector2d::Zero();
  for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
    Landmark landmark;
    landmark.label = std::string(1, static_cast<char>('A' + l));
    landmark.radius_m = scene.radius;
    recording.landmarks.push_back(landmark);
  }
  for (int k = 0; k < scene.stops; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    const double x = 4.5 * k / std::max(scene.stops - 1, 1);
    stop.commanded = {x, scene.straight ? 0.0 : 0.4 * std::sin(x), scene.straight ? 0.0 : 0.3 * std::cos(x)};
    recording.stops.push_back(stop);
    if (!scene.walk) error.setZero();
    error.x() += scene.sigma_s * random.normal();
    error.y() += scene.sigma_s * random.normal();
    const Eigen::Vector2d at = Eigen::Vector2d(stop.commanded.x_m, stop.commanded.y_m) + error;
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
      const Eigen::Vector2d v = scene.landmarks[l] - at;
      const double f = evaluate_polynomial(scene.alpha, v.norm() - scene.radius);
      for (int r = 0; r < scene.repeats; ++r) {
        recording.readings.stop.push_back(k);
        recording.readings.landmark.push_back(static_cast<int>(l));
        recording.readings.repeat.push_back(r);
        recording.readings.range_m.push_back(f + scene.sigma_e * f * f * random.normal());
        recording.readings.bearing_rad.push_back(wrap_angle(
            std::atan2(v.y(), v.x()) - stop.commanded.heading_rad + scene.sigma_theta * random.normal()));
        recording.readings.row.push_back(static_cast<int>(recording.readings.row.size()) + 2);
      }
    }
  }
  return recording;
}

inline JointProblem problem_of(const BearingScene& scene, std::uint64_t seed = 1) {
  const std::vector<Recording> recordings{record(scene, seed)};
  return make_joint_problem(recordings);
}

}  // namespace rangecal::closed_form_tests
