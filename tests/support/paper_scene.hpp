// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <string>
#include <utility>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/problems/world/scene.hpp"

namespace rangecal::testing {

/// The sensor of the 2021 setting before anything stands anywhere: its curve, noise 0.01 f^2, bearings 0.5 degrees.
inline rangecal::Scene paper_scene() {
  rangecal::Scene scene;
  scene.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  scene.noise.law = NoiseLaw::f_squared;
  scene.noise.parameters = Eigen::VectorXd::Constant(1, 0.01);
  scene.sigma_theta_rad = 0.0087;
  return scene;
}

/// A further stop, labelled by its number.
inline void add_stop(rangecal::Scene& scene, const Pose2& commanded) {
  Stop stop;
  stop.label = std::to_string(scene.stops.size());
  stop.commanded = commanded;
  scene.stops.push_back(stop);
}

/// Stop k of a drive on a Lissajous curve of 4 by 3 m.
inline Pose2 on_the_drive(int k, double heading_rad) {
  return {2.0 * std::sin(0.37 * k), 1.5 * std::sin(0.53 * k + 0.4), heading_rad};
}

/// Five cylinders about that drive, each seen from every stop.
inline void add_cylinders(rangecal::Scene& scene) {
  for (const auto& [x, y] : {std::pair{-2.6, 0.3}, {2.7, -0.5}, {0.2, 2.3}, {-1.4, -2.4}, {1.6, 2.2}}) {
    scene.landmarks.push_back({std::string(1, static_cast<char>('A' + scene.landmarks.size())), 0.12, {}});
    scene.positions.emplace_back(x, y);
  }
}

/// Steps of that drive, each off by 3 cm and 0.01 rad, the errors adding up: after 300 the path is turned by
/// 0.17 rad and half a metre away from where it was meant to be, one standard deviation.
inline rangecal::Scene long_walk() {
  rangecal::Scene scene = paper_scene();
  scene.sigma_xy_m = 0.03;
  scene.sigma_heading_rad = 0.01;
  scene.stop_error = StopErrorModel::random_walk;
  scene.repeats = 2;
  for (int k = 0; k < 300; ++k) add_stop(scene, on_the_drive(k, 0.9 * k));
  add_cylinders(scene);
  return scene;
}

/// What was simulated with the sensor of the paper's scene: its curve and noise, and where stops and
/// landmarks are.
inline JointState truth_of(const Recording& recording) {
  const rangecal::Scene sensor = paper_scene();
  JointState truth;
  truth.alpha = sensor.alpha;
  truth.noise = sensor.noise;
  truth.sigma_theta_rad = sensor.sigma_theta_rad;
  for (const auto& stop : recording.truth.stops) truth.stops.push_back(*stop);
  for (const auto& landmark : recording.truth.landmarks) truth.landmarks.push_back(*landmark);
  return truth;
}

}  // namespace rangecal::testing
