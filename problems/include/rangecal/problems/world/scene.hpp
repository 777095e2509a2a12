// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/noise.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal {

/// Landmarks to be drawn: uniform in a box, away from the path and from each other, all distances in metres.
struct RandomLandmarks {
  int count = 0;
  Eigen::Vector2d box_min_m = Eigen::Vector2d::Zero(), box_max_m = Eigen::Vector2d::Zero();
  double path_distance_min_m = 0.4;  ///< from the polyline through the stops, its two ends extended
  double separation_min_m = 0.2;     ///< axis to axis
  double radius_m = 0.0;
};

/// Readings at one known distance d [m].
struct SceneBatch {
  double distance_m = 0.0;
  int readings = 0;
};

/// A distance to be taped, landmark to landmark, with the tape's standard deviation [m].
struct SceneTape {
  int from = 0, to = 0;
  double sigma_m = 0.0;
};

/// When readings are taken: the sweeps of a stop (readings of a batch) sweep_s apart, drive_s from the last sweep of a stop
/// to the first of the next. Without it a recording has no times.
struct SceneTiming {
  double drive_s = 60.0, sweep_s = 0.2;
};

/// Sensor model `optical`: what is physically there in place of f(d). Ideal by default: the range is the distance.
struct SceneOptics {
  world::OpticalSensor sensor;  ///< its nominal focal length and baseline are what the firmware believes
  world::SpinningHead head;
};

/// Catalogued effects by id, with every parameter by its name, as a calibration has them.
using SceneEffects = std::map<std::string, std::map<std::string, double>>;

/// What is simulated: docs/scene.md describes the file, docs/scene.schema.json its schema.
struct Scene {
  RecordingKind kind = RecordingKind::landmarks;

  Sensor sensor;          ///< name, principle, and the range outside which it reports nothing
  Eigen::VectorXd alpha;  ///< f(d) = sum alpha_i d^i; alpha_i in m^(1-i); empty with optics
  std::optional<SceneOptics> optics;
  Noise noise;                   ///< s(d) [m]
  double sigma_theta_rad = 0.0;  ///< of a bearing
  bool reads_bearings = true;    ///< false of a radio, that reads ranges alone

  double sigma_xy_m = 0.01, sigma_heading_rad = 0.0;
  StopErrorModel stop_error = StopErrorModel::independent;
  std::vector<Stop> stops;          ///< commanded poses
  std::vector<Landmark> landmarks;  ///< explicit ones, with their axes in `positions`
  std::vector<Eigen::Vector2d> positions;
  std::optional<RandomLandmarks> random_landmarks;
  std::vector<SceneTape> tapes;
  int repeats = 1;             ///< readings of each visible (stop, landmark)
  double visible_min_m = 0.0;  ///< true distances at which a landmark is seen
  double visible_max_m = std::numeric_limits<double>::infinity();

  std::vector<SceneBatch> batches;  ///< kind pairs

  std::optional<SceneTiming> timing;
  SceneEffects effects;  ///< not with optics
};

/// What a scene may hold: `seed_model`, for those that know no more than f(d), neither effects nor optics.
enum class SceneScope { seed_model, any };

/// A recording of the scene before anything is read: kind, sensor, and how far stops may be from their places.
Recording unread_recording(const Scene& scene);

/// Reads a scene file. Throws InputError naming file, row and field for anything missing, malformed, unknown or beyond
/// `scope`.
Scene load_scene(const std::string& path, SceneScope scope = SceneScope::seed_model);
/// The same from text; `name` stands for the file in messages.
Scene parse_scene(const std::string& text, const std::string& name,
                  SceneScope scope = SceneScope::seed_model);

/// The parameters of an effect in this scene, those left out filled in: 0 where the effect is linear in them, or where
/// another size of the effect is given and 0 is allowed; else the typical value. Throws InputError for what is in no
/// catalogue, out of bounds, or cannot act in this scene.
std::map<std::string, double> scene_effect(const Scene& scene, const std::string& id,
                                           const std::map<std::string, double>& given);

/// What a scene holds beyond the seed model, as it would stand in a scene file: effects with all of their parameters, or
/// the optical sensor. Lines of YAML; empty for the seed model.
std::string departures_text(const Scene& scene);

}  // namespace rangecal
