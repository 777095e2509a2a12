// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/scene_recording.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "cell_filter.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/stop_prior.hpp"
#include "scene_cell.hpp"

namespace rangecal {
namespace {

using Eigen::Vector2d;

Vector2d position_of(const Pose2& pose) { return {pose.x_m, pose.y_m}; }

Vector2d rotated(const Vector2d& v, double angle) {
  const double c = std::cos(angle), s = std::sin(angle);
  return {c * v.x() - s * v.y(), s * v.x() + c * v.y()};
}

std::vector<Pose2> draw_stops(const Scene& scene, std::uint64_t seed) {
  Random random(seed_from("scene stops", {seed}));
  std::vector<Pose2> poses;
  std::map<std::string, Vector2d> errors;  // of the places met so far
  for (std::size_t k = 0; k < scene.stops.size(); ++k) {
    const Stop& stop = scene.stops[k];
    // Drawn whether used or not, so that a stop's numbers do not depend on the other stops' places.
    const double unit_x = random.normal(), unit_y = random.normal(), unit_heading = random.normal();
    StopPrior law;
    law.sigma_xy_m = stop.sigma_xy_m.value_or(scene.sigma_xy_m);
    law.sigma_heading_rad = stop.sigma_heading_rad.value_or(scene.sigma_heading_rad);
    if (stop.covariance) set_covariance(*stop.covariance, law);
    const Eigen::Vector3d drawn = stop_error(law, law.sigma_xy_m, {unit_x, unit_y, unit_heading});
    Vector2d error = drawn.head<2>();
    const double heading_error = drawn.z();
    if (!stop.place.empty()) error = errors.emplace(stop.place, error).first->second;
    if (scene.stop_error == StopErrorModel::independent || k == 0) {
      const Vector2d p = position_of(stop.commanded) + error;
      poses.push_back({p.x(), p.y(), wrap_angle(stop.commanded.heading_rad + heading_error)});
      continue;
    }
    const Pose2& commanded_before = scene.stops[k - 1].commanded;
    const Pose2& before = poses.back();
    const Vector2d step =
        rotated(position_of(stop.commanded) - position_of(commanded_before), -commanded_before.heading_rad);
    // A stop on the same spot as the one before was turned, not moved.
    const bool turned = !stop.place.empty() && stop.place == scene.stops[k - 1].place;
    const Vector2d moved = turned ? Vector2d::Zero().eval() : rotated(step + error, before.heading_rad);
    const Vector2d p = position_of(before) + moved;
    const double turn = stop.commanded.heading_rad - commanded_before.heading_rad + heading_error;
    poses.push_back({p.x(), p.y(), wrap_angle(before.heading_rad + turn)});
  }
  return poses;
}

// Distance from the polyline through the stops, its first and last leg extended without end.
double path_distance(const std::vector<Stop>& stops, const Vector2d& point) {
  double nearest = (point - position_of(stops.front().commanded)).norm();
  for (std::size_t k = 0; k + 1 < stops.size(); ++k) {
    const Vector2d from = position_of(stops[k].commanded);
    const Vector2d leg = position_of(stops[k + 1].commanded) - from;
    if (leg.squaredNorm() == 0.0) continue;
    double along = (point - from).dot(leg) / leg.squaredNorm();
    if (k > 0) along = std::max(along, 0.0);
    if (k + 2 < stops.size()) along = std::min(along, 1.0);
    nearest = std::min(nearest, (point - from - along * leg).norm());
  }
  return nearest;
}

// The scene's landmarks, then the random ones, R0, R1, ...
void place_landmarks(const Scene& scene, std::uint64_t seed, Recording& recording,
                     std::vector<Vector2d>& axes) {
  recording.landmarks = scene.landmarks;
  axes = scene.positions;
  if (!scene.random_landmarks) return;
  constexpr int tries = 10000;
  const RandomLandmarks& wanted = *scene.random_landmarks;
  Random random(seed_from("scene landmarks", {seed}));
  for (int i = 0; i < wanted.count; ++i) {
    bool placed = false;
    for (int t = 0; t < tries && !placed; ++t) {
      const Vector2d point(random.uniform(wanted.box_min_m.x(), wanted.box_max_m.x()),
                           random.uniform(wanted.box_min_m.y(), wanted.box_max_m.y()));
      const bool crowded = std::any_of(axes.begin(), axes.end(), [&](const Vector2d& other) {
        return (other - point).norm() < wanted.separation_min_m;
      });
      const double distance = path_distance(scene.stops, point);
      if (crowded || distance < wanted.path_distance_min_m || distance <= wanted.radius_m) continue;
      std::string label = fmt::format("R{}", i);
      const auto taken = [&](const Landmark& other) { return other.label == label; };
      while (std::any_of(recording.landmarks.begin(), recording.landmarks.end(), taken)) label += "'";
      recording.landmarks.push_back({label, wanted.radius_m, std::nullopt});
      axes.push_back(point);
      placed = true;
    }
    if (!placed) throw InputError("scene: no room for random landmark " + std::to_string(i) + " in its box");
  }
}

/// The readings of each landmark from each stop, one (stop, landmark) after the other.
void keep_readings(const Scene& scene, double lost_beyond_m, Recording& recording) {
  Readings drawn;
  std::swap(drawn, recording.readings);
  const SceneSensor sensor(scene);
  Reporter reporter(scene, recording);
  for (std::size_t begin = 0, end = 0; begin < drawn.size(); begin = end) {
    while (end < drawn.size() && drawn.stop[end] == drawn.stop[begin] &&
           drawn.landmark[end] == drawn.landmark[begin])
      ++end;
    const auto k = static_cast<std::size_t>(drawn.stop[begin]);
    const auto l = static_cast<std::size_t>(drawn.landmark[begin]);
    const double d = (*recording.truth.landmarks[l] - position_of(*recording.truth.stops[k])).norm() -
                     recording.landmarks[l].radius_m;
    if (!(d > 0.0) || d < scene.visible_min_m || d > scene.visible_max_m) continue;
    sensor.at(d);  // throws without a spread
    CellFilter filter(scene.sensor, recording.counts, lost_beyond_m);
    for (std::size_t i = begin; i < end; ++i) filter.add(drawn.range_m[i], drawn.bearing_rad[i]);
    reporter.report_cell(k, l, filter);
  }
}

void keep_pairs(const Scene& scene, double lost_beyond_m, Recording& recording) {
  Pairs drawn;
  std::swap(drawn, recording.pairs);
  const SceneSensor sensor(scene);
  Reporter reporter(scene, recording);
  std::size_t i = 0;
  for (std::size_t b = 0; b < scene.batches.size(); ++b) {
    sensor.at(scene.batches[b].distance_m);
    CellFilter filter(scene.sensor, recording.counts, lost_beyond_m);
    for (int r = 0; r < scene.batches[b].readings; ++r, ++i) filter.add(drawn.reading_m.at(i), 0.0);
    reporter.report_batch(b, scene.batches[b].distance_m, filter);
  }
}

}  // namespace

Recording laid_out(const Scene& scene, std::uint64_t seed) {
  Recording recording = unread_recording(scene);
  if (scene.kind == RecordingKind::pairs) return recording;
  if (scene.stops.empty()) throw InputError("scene: there is no stop");
  const std::vector<Pose2> poses = draw_stops(scene, seed);
  std::vector<Vector2d> axes;
  place_landmarks(scene, seed, recording, axes);
  recording.stops = scene.stops;
  recording.truth.stops.assign(poses.begin(), poses.end());
  recording.truth.landmarks.assign(axes.begin(), axes.end());
  Random tape(seed_from("scene tapes", {seed}));
  for (const SceneTape& wanted : scene.tapes) {
    const Vector2d gap =
        axes[static_cast<std::size_t>(wanted.from)] - axes[static_cast<std::size_t>(wanted.to)];
    recording.known_distances.push_back(
        {wanted.from, wanted.to, tape.normal(gap.norm(), wanted.sigma_m), wanted.sigma_m});
  }
  return recording;
}

std::vector<double> start_times_s(const Scene& scene) {
  std::vector<double> starts;
  if (!scene.timing) return starts;
  double start = 0.0;
  const auto add = [&](int sweeps) {
    starts.push_back(start);
    start += sweeps * scene.timing->sweep_s + scene.timing->drive_s;
  };
  for (const SceneBatch& batch : scene.batches) add(batch.readings);
  for (std::size_t k = 0; k < scene.stops.size(); ++k) add(scene.repeats);
  return starts;
}

void keep_reported(const Scene& scene, double lost_beyond_m, Recording& recording) {
  recording.counts = Counts{};
  if (scene.kind == RecordingKind::pairs)
    keep_pairs(scene, lost_beyond_m, recording);
  else
    keep_readings(scene, lost_beyond_m, recording);
}

}  // namespace rangecal
