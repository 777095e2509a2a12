// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <fmt/core.h>

#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"
#include "rangecal/solvers/study/bound.hpp"

namespace rangecal::benchmark {

/// A scene that the accuracy of estimators is measured in, by name.
struct AccuracySetting {
  std::string name;
  Scene scene;
};

inline const std::vector<double> curve_points = {0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0, 4.5, 5.0};

/// Noise and sigmas of the eight combinations of the 2021 setting.
struct Combination {
  NoiseLaw law;
  double sigma_theta_deg, sigma_s_m;

  Scene apply(Scene scene) const {
    scene.noise.law = law;
    scene.noise.parameters = Eigen::VectorXd::Constant(1, law == NoiseLaw::f ? 0.05 : 0.01);
    scene.sigma_theta_rad = sigma_theta_deg * std::numbers::pi / 180.0;
    scene.sigma_xy_m = sigma_s_m;
    return scene;
  }
  std::string name() const {
    return fmt::format("{}, {:.1f} deg, {:.0f} cm", law == NoiseLaw::f ? "0.05 f" : "0.01 f^2",
                       sigma_theta_deg, 100 * sigma_s_m);
  }
};

/// Five landmarks about the path: at least 0.5 m from its line, 0.4 m from each other.
inline Scene with_random_landmarks(Scene scene, std::uint64_t candidate) {
  Random random(seed_from("joint_accuracy scene", {candidate}));
  for (std::size_t l = 0; l < scene.positions.size();) {
    const Eigen::Vector2d at(random.uniform(-0.5, 4.3), random.uniform(-3.0, 3.0));
    bool good = std::abs(at.y()) >= 0.5;
    for (std::size_t other = 0; other < l; ++other)
      good = good && (at - scene.positions[other]).norm() >= 0.4;
    if (good) scene.positions[l++] = at;
  }
  return scene;
}

/// The largest relative difference, over `curve_points`, between the curve's standard deviation by the bound at the commanded
/// stops and by the hybrid bound.
inline double linearisation_error(const Scene& scene) {
  const SceneTruth truth = scene_truth(scene, 1);
  const auto fixed = cramer_rao_bound(truth.problem, truth.state);
  const auto hybrid = hybrid_cramer_rao_bound(truth.problem, truth.state, 400, 1);
  if (!fixed || !hybrid) return std::numeric_limits<double>::infinity();
  const Eigen::MatrixXd rows = curve_rows(curve_points, scene.alpha.size());
  const Eigen::ArrayXd ratio =
      (variance_along(rows, *fixed).array() / variance_along(rows, *hybrid).array()).sqrt();
  return (ratio - 1.0).abs().maxCoeff();
}

/// The 27 settings: the 2021 setting with 20 and with 200 stops, each in eight combinations; the field layout; and ten scenes of
/// random landmarks, scene i with combination i, the first ten candidates by seed whose linearisation error is below 10 %.
inline std::vector<AccuracySetting> accuracy_settings(const std::string& scene_folder) {
  const Scene setting = load_scene(scene_folder + "/2021-setting.yaml");
  std::vector<Combination> combinations;
  for (const NoiseLaw law : {NoiseLaw::f, NoiseLaw::f_squared})
    for (double sigma_theta_deg : {0.5, 2.0})
      for (double sigma_s_m : {0.01, 0.05}) combinations.push_back({law, sigma_theta_deg, sigma_s_m});
  std::vector<AccuracySetting> settings;
  for (int stops : {20, 200})
    for (const Combination& c : combinations)
      settings.push_back({fmt::format("K = {}, {}", stops, c.name()), c.apply(with_stops(setting, stops))});
  settings.push_back({"field layout", load_scene(scene_folder + "/field-layout.yaml")});
  constexpr std::uint64_t most_candidates = 1000;
  int kept = 0;
  for (std::uint64_t candidate = 0; kept < 10 && candidate < most_candidates; ++candidate) {
    const Combination& c = combinations[static_cast<std::size_t>(kept) % combinations.size()];
    Scene scene = c.apply(with_random_landmarks(setting, candidate));
    const double error = linearisation_error(scene);
    if (!(error < 0.1)) continue;
    settings.push_back(
        {fmt::format("scene {} (seed {}, linearised {:.1f} %), {}", ++kept, candidate, 100 * error, c.name()),
         std::move(scene)});
  }
  return settings;
}

}  // namespace rangecal::benchmark
