// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/polynomial_world.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/stop_prior.hpp"
#include "rangecal/problems/world/scene_size.hpp"

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

double draw_reading(const Scene& scene, double d, Random& random) {
  const double f = evaluate_polynomial(scene.alpha, d);
  const double s = scene.noise.spread(d, f);
  if (!(s > 0.0) || !std::isfinite(s)) {
    throw InputError("scene: the noise has no positive spread at d = " + std::to_string(d) + " m");
  }
  return f + s * random.normal();
}

// The readings of one cell or batch, sorted into those that the sensor reports and those lost, and why.
class CellFilter {
 public:
  CellFilter(const Sensor& sensor, Counts& counts) : sensor_(sensor), counts_(counts) {}

  void add(double range_m, double bearing_rad) {
    ++counts_.read;
    if (range_m == 0.0) {
      ++counts_.dropped["zero"];
    } else if (range_m < 0.0) {
      ++counts_.dropped["negative"];
    } else if (range_m < sensor_.range_min_m) {
      ++counts_.dropped["below range_min_m"];
      ++lost_;
    } else if (range_m > sensor_.range_max_m) {
      ++counts_.dropped["above range_max_m"];
      ++lost_;
    } else {
      kept_.emplace_back(repeat_, range_m, bearing_rad);
    }
    ++repeat_;
  }

  /// Hands every reading that may be used to `use(repeat, range, bearing)`.
  template <typename Use>
  void finish(Use use) {
    const auto kept = static_cast<int>(kept_.size());
    if (100 * lost_ > kept + lost_) {
      ++counts_.cells_left_out;
      if (kept > 0) counts_.dropped["cell cut by a limit"] += kept;
      return;
    }
    counts_.used += kept;
    for (const auto& [repeat, range_m, bearing_rad] : kept_) use(repeat, range_m, bearing_rad);
  }

 private:
  const Sensor& sensor_;
  Counts& counts_;
  int repeat_ = 0, lost_ = 0;
  std::vector<std::tuple<int, double, double>> kept_;
};

void simulate_pairs(const Scene& scene, std::uint64_t seed, Recording& recording) {
  Random random(seed_from("scene readings", {seed}));
  Pairs& pairs = recording.pairs;
  int line = 2;
  for (std::size_t b = 0; b < scene.batches.size(); ++b) {
    const SceneBatch& batch = scene.batches[b];
    CellFilter filter(scene.sensor, recording.counts);
    for (int i = 0; i < batch.readings; ++i) filter.add(draw_reading(scene, batch.distance_m, random), 0.0);
    const auto index = static_cast<int>(pairs.batch_labels.size());
    filter.finish([&](int, double range_m, double) {
      if (static_cast<int>(pairs.batch_labels.size()) == index)
        pairs.batch_labels.push_back(std::to_string(b));
      pairs.batch.push_back(index);
      pairs.true_m.push_back(batch.distance_m);
      pairs.reading_m.push_back(range_m);
      pairs.row.push_back(line++);
    });
  }
}

void simulate_landmarks(const Scene& scene, std::uint64_t seed, Recording& recording) {
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

  Random random(seed_from("scene readings", {seed}));
  Readings& readings = recording.readings;
  int line = 2;
  for (std::size_t k = 0; k < poses.size(); ++k) {
    for (std::size_t l = 0; l < axes.size(); ++l) {
      const Vector2d direction = axes[l] - position_of(poses[k]);
      const double d = direction.norm() - recording.landmarks[l].radius_m;
      if (!(d > 0.0) || d < scene.visible_min_m || d > scene.visible_max_m) continue;
      const double theta = std::atan2(direction.y(), direction.x()) - poses[k].heading_rad;
      CellFilter filter(scene.sensor, recording.counts);
      for (int repeat = 0; repeat < scene.repeats; ++repeat) {
        const double range_m = draw_reading(scene, d, random);
        filter.add(range_m, wrap_angle(theta + scene.sigma_theta_rad * random.normal()));
      }
      filter.finish([&](int repeat, double range_m, double bearing_rad) {
        readings.stop.push_back(static_cast<int>(k));
        readings.landmark.push_back(static_cast<int>(l));
        readings.repeat.push_back(repeat);
        readings.range_m.push_back(range_m);
        readings.bearing_rad.push_back(bearing_rad);
        readings.row.push_back(line++);
      });
    }
  }
}

}  // namespace

Recording simulate(const Scene& scene, std::uint64_t seed) {
  if (scene.alpha.size() == 0) throw InputError("scene: alpha is empty");
  check_size(scene);
  Recording recording = unread_recording(scene);
  if (scene.kind == RecordingKind::pairs) {
    simulate_pairs(scene, seed, recording);
  } else {
    simulate_landmarks(scene, seed, recording);
  }
  return recording;
}

}  // namespace rangecal
