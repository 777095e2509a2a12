// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// State of the base after its temperature rose by delta_k.
struct ThermalState {
  double temperature_c = 22.0, zero_m = 0.0, pointing_rad = 0.0, baseline_factor = 1.0;
};
ThermalState thermal_state(const Thermal& thermal, double time_s);

/// Where the centroid finder puts the spot of a surface at distance d along the beam [mm on the detector].
///   x = f s / d - f tan(psi) + shift,  lens: x (1 + k1 x^2),  skew, stray light, then the pixels.
/// `ambient_ratio` is B/S for this beam; `skew_px` the landmark's own shift.
double centroid_mm(const OpticalSensor& sensor, const AmbientLight& ambient, const ThermalState& base,
                   double distance_m, double ambient_ratio, double skew_px);

/// Centroid of a Gaussian spot at position_px (pixel centres at the integers) from the light each pixel
/// collects, over the nine pixels around the brightest [px].
double pixel_centroid_px(double position_px, double spot_sigma_px);

/// What the firmware makes of the centroid: rounding, (f s)_nominal / x, zero, near table, output step [m].
/// `distance_m` decides which table is used. Infinity where x is not positive.
double firmware_range_m(const OpticalSensor& sensor, double x_mm, double distance_m, double thermal_zero_m);

/// d as a phase channel with a leaking reference sees it: the angle of the sum of two phasors [m].
double with_crosstalk_m(const OpticalSensor& sensor, double distance_m);

}  // namespace rangecal::world
