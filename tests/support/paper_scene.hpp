// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

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

}  // namespace rangecal::testing
