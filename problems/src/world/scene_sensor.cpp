// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>

#include <algorithm>
#include <cmath>

#include "rangecal/core/errors.hpp"
#include "scene_parts.hpp"

namespace rangecal::scene_parts {
namespace {

void read_noise(const YamlReader& node, Scene& scene) {
  node.allow_only({"law", "sigma", "beta"});
  const YamlReader law = node.at("law");
  try {
    scene.noise.law = noise_law_from_string(law.text());
  } catch (const InputError& error) {
    law.fail(error.what());
  }
  if (!has_sigma(scene.noise.law)) {
    if (node.has("sigma")) node.at("sigma").fail("the polynomial law has beta in its place");
    scene.noise.parameters = coefficients(node.at("beta"));
  } else {
    if (node.has("beta")) node.at("beta").fail("belongs to the polynomial law");
    scene.noise.parameters = Eigen::VectorXd::Constant(1, node.at("sigma").positive());
  }
}

/// What sensors of both models have: `principle` is the one to fall back on.
void read_common(const YamlReader& node, const char* principle, Scene& scene) {
  scene.sensor.name = node.has("name") ? node.at("name").text() : "simulated";
  scene.sensor.principle = node.has("principle") ? node.at("principle").text() : principle;
  read_noise(node.at("noise"), scene);
  if (scene.kind == RecordingKind::landmarks) {
    const YamlReader of_bearings = node.at("sigma_theta_rad");
    scene.reads_bearings = of_bearings.text() != "none";
    if (scene.reads_bearings) scene.sigma_theta_rad = of_bearings.not_negative();
  }
  if (node.has("range_min_m")) scene.sensor.range_min_m = node.at("range_min_m").not_negative();
  if (node.has("range_max_m")) {
    scene.sensor.range_max_m = node.at("range_max_m").number();
    if (!(scene.sensor.range_max_m > scene.sensor.range_min_m))
      node.at("range_max_m").fail("is not above range_min_m");
  }
}

/// The firmware believes in the sensor as it is, unless it is told otherwise.
SceneOptics read_optics(const YamlReader& node, const Scene& scene) {
  if (node.has("alpha"))
    node.at("alpha").fail("belongs to the polynomial model: here the optics make the curve");
  node.allow_only({"model",
                   "name",
                   "principle",
                   "noise",
                   "sigma_theta_rad",
                   "range_min_m",
                   "range_max_m",
                   "baseline_mm",
                   "focal_mm",
                   "nominal_baseline_mm",
                   "nominal_focal_mm",
                   "laser_angle_rad",
                   "detector_shift_mm",
                   "range_zero_m",
                   "pitch_mm",
                   "k1_per_mm2",
                   "spot_sigma_px",
                   "centroid_step_px",
                   "output_lsb_m",
                   "tilt_rad",
                   "tilt_axis_rad",
                   "cover_offset_m",
                   "cover_phase_rad",
                   "disc_offset_mm",
                   "disc_phase_rad"});
  SceneOptics optics;
  for (const OpticsField& field : optics_fields()) {
    if (!node.has(field.name)) continue;
    const YamlReader item = node.at(field.name);
    if (field.head && scene.kind == RecordingKind::pairs)
      item.fail("belongs to the head that turns the sensor: pairs have no directions");
    const double value = item.number();
    if (!(value >= field.low && value <= field.high))
      item.fail(fmt::format("{} is outside {:g} to {:g}", value, field.low, field.high));
    value_of(field, optics) = value;
  }
  world::OpticalSensor& sensor = optics.sensor;
  if (!node.has("nominal_baseline_mm")) sensor.nominal_baseline_mm = sensor.baseline_mm;
  if (!node.has("nominal_focal_mm")) sensor.nominal_focal_mm = sensor.focal_mm;
  return optics;
}

}  // namespace

const std::vector<OpticsField>& optics_fields() {
  using world::OpticalSensor;
  using world::SpinningHead;
  constexpr double small = 1e-3, turn = 6.283185307179586;
  static const std::vector<OpticsField> fields{
      {"baseline_mm", &OpticalSensor::baseline_mm, nullptr, small, 1e4},
      {"focal_mm", &OpticalSensor::focal_mm, nullptr, small, 1e4},
      {"nominal_baseline_mm", &OpticalSensor::nominal_baseline_mm, nullptr, small, 1e4},
      {"nominal_focal_mm", &OpticalSensor::nominal_focal_mm, nullptr, small, 1e4},
      {"laser_angle_rad", &OpticalSensor::laser_angle_rad, nullptr, -0.5, 0.5},
      {"detector_shift_mm", &OpticalSensor::detector_shift_mm, nullptr, -1.0, 1.0},
      {"range_zero_m", &OpticalSensor::range_zero_m, nullptr, -2.0, 2.0},
      {"pitch_mm", &OpticalSensor::pitch_mm, nullptr, 1e-5, 1.0},
      {"k1_per_mm2", &OpticalSensor::k1_per_mm2, nullptr, -1.0, 1.0},
      {"spot_sigma_px", &OpticalSensor::spot_sigma_px, nullptr, 0.0, 2.0},
      {"centroid_step_px", &OpticalSensor::centroid_step_px, nullptr, 0.0, 10.0},
      {"output_lsb_m", &OpticalSensor::output_lsb_m, nullptr, 0.0, 1.0},
      {"tilt_rad", nullptr, &SpinningHead::tilt_rad, -0.35, 0.35},
      {"tilt_axis_rad", nullptr, &SpinningHead::tilt_axis_rad, -turn, turn},
      {"cover_offset_m", nullptr, &SpinningHead::cover_offset_m, 0.0, 0.1},
      {"cover_phase_rad", nullptr, &SpinningHead::cover_phase_rad, -turn, turn},
      {"disc_offset_mm", nullptr, &SpinningHead::disc_offset_mm, 0.0, 10.0},
      {"disc_phase_rad", nullptr, &SpinningHead::disc_phase_rad, -turn, turn}};
  return fields;
}

void read_sensor(const YamlReader& node, Scene& scene) {
  const std::string model = node.has("model") ? node.at("model").text() : "polynomial";
  if (model == "optical") {
    scene.optics = read_optics(node, scene);
    read_common(node, "triangulation", scene);
    return;
  }
  node.allow_only(
      {"model", "name", "principle", "alpha", "noise", "sigma_theta_rad", "range_min_m", "range_max_m"});
  if (model != "polynomial")
    node.at("model").fail("'" + model.substr(0, 40) + "' is neither polynomial nor optical");
  scene.alpha = coefficients(node.at("alpha"));
  read_common(node, "polynomial", scene);
}

void check_optics(const YamlReader& sensor, const Scene& scene) {
  if (scene.optics->head.tilt_rad == 0.0) return;
  const auto thin = [](const auto& landmark) { return !(landmark.radius_m > 0.0); };
  if ((scene.random_landmarks && thin(*scene.random_landmarks)) ||
      std::any_of(scene.landmarks.begin(), scene.landmarks.end(), thin))
    sensor.at("tilt_rad").fail("needs landmarks with a radius_m: a tilted beam misses a line");
}

}  // namespace rangecal::scene_parts
