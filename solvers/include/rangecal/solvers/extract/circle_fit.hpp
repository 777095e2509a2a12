// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>

namespace rangecal {

/// One beam that hit: direction in the sensor frame [rad] and reading [m].
struct Beam {
  double bearing_rad = 0.0, range_m = 0.0;
};

/// What the outline says besides the ranges: the middle between the first and the last hit, and its spread.
struct Outline {
  double centre_rad = 0.0, centre_sd_rad = 0.0;
  double half_width_rad = 0.0;  ///< half the angle between the two edges
};
/// The edge lies anywhere between the last hit and the first miss, uniformly: with gaps g_l, g_r between them
///   centre = (left + right) / 2,   variance = (g_l^2 + g_r^2) / 48      (even grid: step^2 / 24)
Outline outline_of(double miss_left_rad, double hit_left_rad, double hit_right_rad, double miss_right_rad);

struct CircleFitOptions {
  std::optional<double> radius_m = std::nullopt;  ///< known radius; estimated where there is none
  double sigma_m = 0.01;                          ///< standard deviation of one beam's range at this distance
  double edge_cut = 0.9;  ///< beams that pass the axis at more than this share of R are dropped
  double radius_min_m = 0.005, radius_max_m = 0.5;  ///< where it is estimated
};

/// A cylinder seen in one scan.
struct CircleFit {
  double range_m = 0.0, bearing_rad = 0.0, radius_m = 0.0;  ///< nearest point of the arc; axis; radius
  double range_sd_m = 0.0, bearing_sd_rad = 0.0, radius_sd_m = 0.0;  ///< radius_sd_m is 0 where it is known
  double mean_m = 0.0, mean_sd_m = 0.0;                              ///< mean of the readings used
  double smallest_m = 0.0;                                           ///< smallest of them
  double chi_squared = 0.0;                                          ///< of range residuals and outline
  int degrees_of_freedom = 0;
  int used = 0, edge_beams = 0;  ///< beams fitted; beams dropped at the edges
};

/// Geometric fit of a cylinder of radius R at range s (nearest point) and bearing b to the beams along themselves:
///   r_i = D cos(psi_i) - sqrt(R^2 - D^2 sin^2(psi_i)) + N(0, sigma^2),  psi_i = bearing_i - b,  D = s + R,
/// and centre of the outline = b + N(0, its variance): Gauss-Newton on (s, b), or (s, b, R). Standard deviations are
/// those of the Fisher information, so they count the beams. Nothing where it does not converge, where fewer than two
/// beams (three with R unknown) are left inside the edges, or where R leaves its limits. Cost: linear in the beams.
std::optional<CircleFit> fit_circle(std::span<const Beam> beams, const Outline& outline,
                                    const CircleFitOptions& options);

/// What a flat face makes of the same beams.
struct FlatFit {
  double chi_squared = 0.0;  ///< of the best straight line, ranges alone
  int degrees_of_freedom = 0;
};
/// Best straight line through the beams: 1/r_i = p cos(bearing_i) + q sin(bearing_i), weighted by r^2 / sigma.
FlatFit fit_flat(std::span<const Beam> beams, double sigma_m);

/// The reading that the cylinder gives at psi from its axis; nothing where the beam misses it.
std::optional<double> range_on_circle(double axis_distance_m, double radius_m, double psi_rad);

}  // namespace rangecal
