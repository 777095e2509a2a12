// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/optical_sensor.hpp"

#include <cmath>
#include <limits>
#include <numbers>

namespace rangecal::world {

ThermalState thermal_state(const Thermal& thermal, double time_s) {
  const double rise_k = thermal.rise_k * (1.0 - std::exp(-(thermal.soaked_s + time_s) / thermal.time_s));
  return {thermal.start_c + rise_k, thermal.zero_m_per_k * rise_k, thermal.pointing_rad_per_k * rise_k,
          1.0 + thermal.baseline_per_k * rise_k};
}

double pixel_centroid_px(double position_px, double spot_sigma_px) {
  const double brightest = std::round(position_px);
  const double scale = 1.0 / (spot_sigma_px * std::numbers::sqrt2);
  constexpr int reach = 4;
  double light = 0.0, moment = 0.0;
  double below = std::erf((brightest - reach - 0.5 - position_px) * scale);
  for (int i = -reach; i <= reach; ++i) {
    const double above = std::erf((brightest + i + 0.5 - position_px) * scale);
    light += above - below;
    moment += (above - below) * i;
    below = above;
  }
  return brightest + moment / light;
}

double centroid_mm(const OpticalSensor& sensor, const AmbientLight& ambient, const ThermalState& base,
                   double distance_m, double ambient_ratio, double skew_px) {
  const double depth_mm = 1000.0 * distance_m;
  const double lateral_mm = sensor.baseline_mm * base.baseline_factor -
                            depth_mm * std::tan(sensor.laser_angle_rad + base.pointing_rad);
  double x = sensor.focal_mm * lateral_mm / depth_mm;
  x *= 1.0 + sensor.k1_per_mm2 * x * x;
  x += sensor.detector_shift_mm;
  double shift_px = skew_px;
  if (ambient_ratio > 0.0) shift_px += ambient_ratio / (1.0 + ambient_ratio) * ambient.window_offset_px;
  x += shift_px * sensor.pitch_mm;
  if (sensor.spot_sigma_px > 0.0)
    x = sensor.pitch_mm * pixel_centroid_px(x / sensor.pitch_mm, sensor.spot_sigma_px);
  return x;
}

double firmware_range_m(const OpticalSensor& sensor, double x_mm, double distance_m, double thermal_zero_m) {
  double x = x_mm;
  if (sensor.centroid_step_px > 0.0) {
    const double step_mm = sensor.centroid_step_px * sensor.pitch_mm;
    x = step_mm * std::round(x / step_mm);
  }
  if (!(x > 0.0)) return std::numeric_limits<double>::infinity();
  double range_m = 1e-3 * sensor.nominal_focal_mm * sensor.nominal_baseline_mm / x;
  range_m += sensor.range_zero_m + thermal_zero_m;
  if (distance_m < sensor.near_below_m) range_m += sensor.near_offset_m;
  if (sensor.output_lsb_m > 0.0) range_m = sensor.output_lsb_m * std::round(range_m / sensor.output_lsb_m);
  return range_m;
}

double with_crosstalk_m(const OpticalSensor& sensor, double distance_m) {
  if (!(sensor.modulation_length_m > 0.0)) return distance_m;
  const double per_rad = sensor.modulation_length_m / (2.0 * std::numbers::pi);
  const double difference = sensor.crosstalk_phase_rad - distance_m / per_rad;  // leak against signal
  const double error_rad =
      std::atan2(sensor.crosstalk * std::sin(difference), 1.0 + sensor.crosstalk * std::cos(difference));
  return distance_m + per_rad * error_rad;
}

}  // namespace rangecal::world
