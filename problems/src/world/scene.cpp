// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/scene.hpp"

#include <fmt/format.h>

#include <cmath>
#include <numbers>
#include <set>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/core/yaml_reader.hpp"
#include "rangecal/problems/world/scene_size.hpp"
#include "scene_parts.hpp"

namespace rangecal {
namespace {

using scene_parts::coefficients;

constexpr double most_random = 1e4, most_readings = 1e8;

double angle(const YamlReader& node) {
  const double value = node.number();
  if (!(std::abs(value) <= 2.0 * std::numbers::pi)) {
    node.fail("is beyond +-2 pi rad: degrees, most likely; convert to radians");
  }
  return wrap_angle(value);
}

double coordinate(const YamlReader& node) {
  const double value = node.number();
  if (!std::isfinite(value)) node.fail("is not finite");
  return value;
}

// Two numbers, the first not above the second.
std::pair<double, double> interval(const YamlReader& node) {
  const std::vector<double> values = node.numbers();
  if (values.size() != 2 || values[0] > values[1]) node.fail("is not [low, high]");
  return {values[0], values[1]};
}

void read_line(const YamlReader& node, Scene& scene) {
  node.allow_only({"count", "start_m", "step_m", "direction_rad", "heading_rad"});
  const int count = node.at("count").whole(1);
  if (count > most_scene_stops) node.at("count").fail("is more than a million stops");
  const double step = node.at("step_m").positive();
  const double direction = node.has("direction_rad") ? angle(node.at("direction_rad")) : 0.0;
  const double heading = node.has("heading_rad") ? angle(node.at("heading_rad")) : direction;
  Eigen::Vector2d start = Eigen::Vector2d::Zero();
  if (node.has("start_m")) {
    const Eigen::VectorXd values = coefficients(node.at("start_m"));
    if (values.size() != 2) node.at("start_m").fail("is not [x, y]");
    start = values;
  }
  for (int k = 0; k < count; ++k) {
    Stop stop;
    stop.label = std::to_string(k);
    stop.commanded = {start.x() + k * step * std::cos(direction), start.y() + k * step * std::sin(direction),
                      heading};
    scene.stops.push_back(std::move(stop));
  }
}

/// A covariance takes the place of the sigmas that the stop has.
void read_covariance(const YamlReader& item, double sigma_heading_rad, Stop& stop) {
  CovarianceEntries entries;
  for (std::size_t i = 0; i < entries.size(); ++i)
    if (item.has(covariance_columns[i])) entries[i] = item.at(covariance_columns[i]).number();
  const StopCovariance covariance =
      stop_covariance(entries, stop.sigma_heading_rad.value_or(sigma_heading_rad));
  if (!covariance.fault.empty())
    item.fail(std::string(covariance_columns[covariance.at]) + " " + covariance.fault);
  if (!covariance.matrix) return;
  if (stop.sigma_xy_m) item.fail("has both a sigma_xy_m and a covariance");
  if (entries[3] && stop.sigma_heading_rad) item.fail("has both a sigma_heading_rad and a cov_hh_rad2");
  stop.covariance = covariance.matrix;
  stop.sigma_heading_rad.reset();
}

void read_stop_list(const YamlReader& node, Scene& scene) {
  std::set<std::string> seen;
  for (const YamlReader& item : node.items()) {
    item.allow_only({"stop", "x_m", "y_m", "heading_rad", "sigma_xy_m", "sigma_heading_rad", "place",
                     "cov_xx_m2", "cov_xy_m2", "cov_yy_m2", "cov_hh_rad2", "cov_xh_m_rad", "cov_yh_m_rad"});
    Stop stop;
    stop.label = item.has("stop") ? item.at("stop").text() : std::to_string(scene.stops.size());
    if (!seen.insert(stop.label).second) item.fail("stop '" + stop.label + "' stands twice");
    stop.commanded.x_m = coordinate(item.at("x_m"));
    stop.commanded.y_m = coordinate(item.at("y_m"));
    if (item.has("heading_rad")) stop.commanded.heading_rad = angle(item.at("heading_rad"));
    if (item.has("sigma_xy_m")) stop.sigma_xy_m = item.at("sigma_xy_m").not_negative();
    if (item.has("sigma_heading_rad")) stop.sigma_heading_rad = item.at("sigma_heading_rad").not_negative();
    if (item.has("place")) stop.place = item.at("place").text();
    read_covariance(item, scene.sigma_heading_rad, stop);
    scene.stops.push_back(std::move(stop));
  }
}

void read_stops(const YamlReader& node, Scene& scene) {
  node.allow_only({"line", "list", "sigma_xy_m", "sigma_heading_rad", "error"});
  if (node.has("line") == node.has("list")) node.fail("one of line and list is needed");
  if (node.has("sigma_xy_m")) scene.sigma_xy_m = node.at("sigma_xy_m").not_negative();
  if (node.has("sigma_heading_rad")) scene.sigma_heading_rad = node.at("sigma_heading_rad").not_negative();
  if (node.has("line")) read_line(node.at("line"), scene);
  if (node.has("list")) read_stop_list(node.at("list"), scene);
  if (scene.stops.empty()) node.fail("there is no stop");
  if (!node.has("error")) return;
  const YamlReader error = node.at("error");
  if (error.text() == "random_walk") {
    scene.stop_error = StopErrorModel::random_walk;
  } else if (error.text() != "independent") {
    error.fail("'" + error.text().substr(0, 40) + "' is neither independent nor random_walk");
  }
}

void read_random_landmarks(const YamlReader& node, double radius_m, Scene& scene) {
  node.allow_only({"count", "x_m", "y_m", "path_distance_min_m", "separation_min_m"});
  RandomLandmarks random;
  random.count = node.at("count").whole(1);
  const auto [x_low, x_high] = interval(node.at("x_m"));
  const auto [y_low, y_high] = interval(node.at("y_m"));
  random.box_min_m = {x_low, y_low};
  random.box_max_m = {x_high, y_high};
  if (node.has("path_distance_min_m"))
    random.path_distance_min_m = node.at("path_distance_min_m").not_negative();
  if (node.has("separation_min_m")) random.separation_min_m = node.at("separation_min_m").not_negative();
  random.radius_m = radius_m;
  scene.random_landmarks = random;
}

void read_landmarks(const YamlReader& node, Scene& scene) {
  node.allow_only({"list", "random", "radius_m"});
  if (!node.has("list") && !node.has("random")) node.fail("one of list and random is needed");
  const double radius = node.has("radius_m") ? node.at("radius_m").not_negative() : 0.0;
  if (node.has("random")) read_random_landmarks(node.at("random"), radius, scene);
  if (!node.has("list")) return;
  std::set<std::string> seen;
  for (const YamlReader& item : node.at("list").items()) {
    item.allow_only({"landmark", "x_m", "y_m", "radius_m", "reflectance"});
    Landmark landmark;
    landmark.label = item.at("landmark").text();
    if (!seen.insert(landmark.label).second) item.fail("landmark '" + landmark.label + "' stands twice");
    landmark.radius_m = item.has("radius_m") ? item.at("radius_m").not_negative() : radius;
    if (item.has("reflectance")) landmark.reflectance = item.at("reflectance").not_negative();
    const Eigen::Vector2d position(coordinate(item.at("x_m")), coordinate(item.at("y_m")));
    if (static_cast<double>(scene.stops.size()) * static_cast<double>(scene.landmarks.size() + 1) >
        most_readings)
      item.fail("with these stops there are more than 1e8 readings");
    for (const Stop& stop : scene.stops) {
      if ((position - Eigen::Vector2d(stop.commanded.x_m, stop.commanded.y_m)).norm() <= landmark.radius_m) {
        item.fail("landmark '" + landmark.label + "' covers stop '" + stop.label + "'");
      }
    }
    scene.landmarks.push_back(std::move(landmark));
    scene.positions.push_back(position);
  }
}

void read_tapes(const YamlReader& node, Scene& scene) {
  const auto index_of = [&](const YamlReader& label) {
    for (std::size_t i = 0; i < scene.landmarks.size(); ++i) {
      if (scene.landmarks[i].label == label.text()) return static_cast<int>(i);
    }
    label.fail("unknown landmark '" + label.text() + "'");
  };
  for (const YamlReader& item : node.items()) {
    item.allow_only({"from", "to", "sigma_m"});
    const SceneTape tape{index_of(item.at("from")), index_of(item.at("to")), item.at("sigma_m").positive()};
    if (tape.from == tape.to) item.fail("goes from a landmark to itself");
    scene.tapes.push_back(tape);
  }
}

void read_visibility(const YamlReader& node, Scene& scene) {
  node.allow_only({"min_m", "max_m"});
  if (node.has("min_m")) scene.visible_min_m = node.at("min_m").not_negative();
  if (node.has("max_m")) scene.visible_max_m = node.at("max_m").number();
  if (!(scene.visible_max_m > scene.visible_min_m)) node.fail("max_m is not above min_m");
}

void read_timing(const YamlReader& node, Scene& scene) {
  node.allow_only({"drive_s", "sweep_s"});
  scene.timing = SceneTiming{};
  if (node.has("drive_s")) scene.timing->drive_s = node.at("drive_s").not_negative();
  if (node.has("sweep_s")) scene.timing->sweep_s = node.at("sweep_s").positive();
}

void read_batches(const YamlReader& node, Scene& scene) {
  node.allow_only({"distances_m", "readings"});
  const int readings = node.at("readings").whole(1);
  for (const YamlReader& item : node.at("distances_m").items())
    scene.batches.push_back({item.positive(), readings});
  if (scene.batches.empty()) node.at("distances_m").fail("holds no number");
}

void read_landmark_scene(const YamlReader& top, Scene& scene) {
  top.allow_only({"format", "kind", "sensor", "stops", "landmarks", "known_distances", "repeats",
                  "visibility", "timing", "effects"});
  scene_parts::read_sensor(top.at("sensor"), scene);
  read_stops(top.at("stops"), scene);
  read_landmarks(top.at("landmarks"), scene);
  if (top.has("known_distances")) read_tapes(top.at("known_distances"), scene);
  if (top.has("repeats")) scene.repeats = top.at("repeats").whole(1);
  if (top.has("visibility")) read_visibility(top.at("visibility"), scene);
}

void read_pairs_scene(const YamlReader& top, Scene& scene) {
  top.allow_only({"format", "kind", "sensor", "batches", "timing", "effects"});
  scene_parts::read_sensor(top.at("sensor"), scene);
  read_batches(top.at("batches"), scene);
}

void read_departures(const YamlReader& top, SceneScope scope, Scene& scene) {
  const char* elsewhere = "is for 'rangecal simulate': the seed model alone is taken here";
  if (scene.optics) {
    if (scope == SceneScope::seed_model) top.at("sensor").at("model").fail(elsewhere);
    scene_parts::check_optics(top.at("sensor"), scene);
  }
  if (!top.has("effects")) return;
  const YamlReader effects = top.at("effects");
  if (scope == SceneScope::seed_model) effects.fail(elsewhere);
  if (scene.optics)
    effects.fail("act on a polynomial sensor: what departs in an optical one are fields of its own");
  scene_parts::read_effects(effects, scene);
}

Scene read_scene(const YamlReader& top, SceneScope scope) {
  Scene scene;
  const YamlReader format = top.at("format");
  if (format.text() != "rangecal-scene/1") {
    format.fail("'" + format.text().substr(0, 40) + "' is not rangecal-scene/1");
  }
  const std::string kind = top.has("kind") ? top.at("kind").text() : "landmarks";
  if (kind == "pairs") {
    scene.kind = RecordingKind::pairs;
    read_pairs_scene(top, scene);
  } else if (kind == "landmarks") {
    read_landmark_scene(top, scene);
  } else {
    top.at("kind").fail("'" + kind.substr(0, 40) + "' is neither landmarks nor pairs");
  }
  if (top.has("timing")) read_timing(top.at("timing"), scene);
  try {
    check_size(scene);
  } catch (const InputError& error) {
    top.fail(error.what());
  }
  read_departures(top, scope, scene);
  return scene;
}

}  // namespace

Recording unread_recording(const Scene& scene) {
  Recording recording;
  recording.kind = scene.kind;
  recording.sensor = scene.sensor;
  recording.sigma_xy_m = scene.sigma_xy_m;
  recording.sigma_heading_rad = scene.sigma_heading_rad;
  recording.stop_error = scene.stop_error;
  return recording;
}

void check_size(const Scene& scene) {
  const int random = scene.random_landmarks ? scene.random_landmarks->count : 0;
  const auto stops = static_cast<double>(scene.stops.size());
  double readings =
      stops * static_cast<double>(scene.landmarks.size() + static_cast<std::size_t>(random)) * scene.repeats;
  for (const SceneBatch& batch : scene.batches) readings += batch.readings;
  if (stops > most_scene_stops) throw InputError("scene: more than a million stops");
  if (random > most_random) throw InputError("scene: more than 10000 random landmarks");
  if (readings > most_readings)
    throw InputError(fmt::format("scene: {:.3g} readings are more than 1e8", readings));
}

Scene load_scene(const std::string& path, SceneScope scope) {
  return read_scene(YamlReader::open(path), scope);
}

Scene parse_scene(const std::string& text, const std::string& name, SceneScope scope) {
  return read_scene(YamlReader::parse(text, name), scope);
}

}  // namespace rangecal
