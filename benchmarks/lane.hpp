// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <utility>
#include <vector>

#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal::benchmark {

/// Order 2, sigma_e 0.05 f, sigma_theta 0.5 degrees, sigma_s 2 cm, cylinders of 12 cm.
inline JointState lane_truth() {
  JointState truth;
  truth.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  truth.noise = {NoiseLaw::f, Eigen::VectorXd::Constant(1, 0.05)};
  truth.sigma_theta_rad = 0.0087;
  return truth;
}

/// K stops along a lane of landmarks, to and fro; each sees at most `sight` of the L landmarks, the nearest. `drawn`: the
/// truth behind the readings.
inline JointProblem make_lane(int stops, int landmarks, int sight, std::uint64_t seed,
                              JointState* drawn = nullptr) {
  Random random(seed_from("joint_speed", {static_cast<std::uint64_t>(stops), seed}));
  JointProblem p;
  JointState truth = lane_truth();
  const double sigma_e = truth.noise.parameters[0], sigma_s = 0.02, radius = 0.12;
  const double length = landmarks <= 5 ? 6.0 : landmarks * 0.6;
  std::vector<Eigen::Vector2d> m;
  for (int l = 0; l < landmarks; ++l) {
    m.emplace_back(length * (l + 0.5) / landmarks, (l % 2 ? -1.0 : 1.0) * random.uniform(1.4, 2.6));
    p.landmark_radius_m.push_back(radius);
    p.landmark_recording.push_back(0);
  }
  Cells& c = p.cells;
  c.stop_begin.push_back(0);
  for (int k = 0; k < stops; ++k) {
    StopPrior prior;
    prior.commanded = {length * (k + 0.5) / stops, random.uniform(-0.5, 0.5), 0.0};
    prior.sigma_xy_m = sigma_s;
    prior.place = p.place_count++;
    p.stops.push_back(prior);
    p.sigma_s_shared.push_back(0);
    const Eigen::Vector2d at(prior.commanded.x_m + random.normal(0, sigma_s),
                             prior.commanded.y_m + random.normal(0, sigma_s));
    truth.stops.push_back({at.x(), at.y(), 0.0});
    std::vector<std::pair<double, int>> near;
    for (int l = 0; l < landmarks; ++l) near.emplace_back((m[l] - at).norm(), l);
    std::sort(near.begin(), near.end());
    near.resize(std::min(sight, landmarks));
    std::sort(near.begin(), near.end(), [](const auto& a, const auto& b) { return a.second < b.second; });
    for (const auto& [distance, l] : near) {
      const double f = evaluate_polynomial(truth.alpha, distance - radius);
      c.stop.push_back(k);
      c.landmark.push_back(l);
      c.count.push_back(1.0);
      c.range_weight.push_back(1.0);
      c.bearing_weight.push_back(1.0);
      c.range_mean.push_back(f + random.normal(0, sigma_e * f));
      c.range_mean_square.push_back(0.0);
      c.bearing_mean.push_back(std::atan2(m[l].y() - at.y(), m[l].x() - at.x()) +
                               random.normal(0, truth.sigma_theta_rad));
      c.bearing_mean_square.push_back(0.0);
      c.radius_m.push_back(radius);
      p.readings += 1.0;
    }
    c.stop_begin.push_back(static_cast<int>(c.stop.size()));
  }
  truth.landmarks = m;
  if (drawn) *drawn = truth;
  return p;
}

}  // namespace rangecal::benchmark
