// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/polynomial_world.hpp"

#include <cmath>

#include "cell_filter.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/scene_size.hpp"
#include "scene_cell.hpp"

namespace rangecal {
namespace {

using Eigen::Vector2d;

void simulate_pairs(const Scene& scene, std::uint64_t seed, Recording& recording) {
  Random random(seed_from("scene readings", {seed}));
  const SceneSensor sensor(scene);
  Reporter reporter(scene, recording);
  for (std::size_t b = 0; b < scene.batches.size(); ++b) {
    const SceneBatch& batch = scene.batches[b];
    const SceneCell cell = sensor.at(batch.distance_m);
    CellFilter filter(scene.sensor, recording.counts);
    for (int i = 0; i < batch.readings; ++i) filter.add(sensor.reading(cell, random.normal()), 0.0);
    reporter.report_batch(b, batch.distance_m, filter);
  }
}

void simulate_landmarks(const Scene& scene, std::uint64_t seed, Recording& recording) {
  Random random(seed_from("scene readings", {seed}));
  const SceneSensor sensor(scene);
  Reporter reporter(scene, recording);
  for (std::size_t k = 0; k < recording.stops.size(); ++k) {
    const Pose2& pose = *recording.truth.stops[k];
    const std::vector<world::Exposure> exposures = sensor.exposures(recording, pose);
    for (std::size_t l = 0; l < recording.landmarks.size(); ++l) {
      const Vector2d direction = *recording.truth.landmarks[l] - Vector2d(pose.x_m, pose.y_m);
      const double d = direction.norm() - recording.landmarks[l].radius_m;
      if (!(d > 0.0) || d < scene.visible_min_m || d > scene.visible_max_m) continue;
      const double theta = std::atan2(direction.y(), direction.x()) - pose.heading_rad;
      const SceneCell cell = sensor.of(d, theta, exposures.empty() ? nullptr : &exposures[l]);
      CellFilter filter(scene.sensor, recording.counts);
      for (int repeat = 0; repeat < scene.repeats; ++repeat) {
        const double range_m = sensor.reading(cell, random.normal());
        filter.add(range_m, wrap_angle(cell.bearing_rad + scene.sigma_theta_rad * random.normal()));
      }
      reporter.report_cell(k, l, filter);
    }
  }
}

}  // namespace

Recording simulate(const Scene& scene, std::uint64_t seed) {
  if (!scene.effects.empty()) throw InputError("scene: it holds effects, which the seed model does not know");
  check_size(scene);
  Recording recording = laid_out(scene, seed);
  if (scene.kind == RecordingKind::pairs) {
    simulate_pairs(scene, seed, recording);
  } else {
    simulate_landmarks(scene, seed, recording);
    if (!scene.reads_bearings) recording.readings.bearing_rad.clear();
  }
  return recording;
}

}  // namespace rangecal
