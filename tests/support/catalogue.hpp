// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

namespace rangecal::test {

/// The ids of the catalogue, as the diagnosis promises them to its users.
inline const std::vector<std::string> catalogue{"axial_depth",
                                                "range_offset",
                                                "arc_definition",
                                                "range_scale",
                                                "laser_pointing",
                                                "lens_distortion",
                                                "pixel_locking",
                                                "quantisation",
                                                "near_regime",
                                                "target_reflectance",
                                                "dark_target",
                                                "ambient_light",
                                                "mixed_pixels",
                                                "tilt",
                                                "warmup_drift",
                                                "range_eccentricity",
                                                "landmark_shape",
                                                "cyclic_error",
                                                "landmark_radius",
                                                "radius_scale",
                                                "bearing_offset",
                                                "bearing_drift",
                                                "beam_offset",
                                                "encoder_eccentricity",
                                                "encoder_ellipticity",
                                                "bearing_scale",
                                                "bearing_quantisation",
                                                "sweep_motion",
                                                "settling",
                                                "odometry_scale",
                                                "path_curvature",
                                                "heading_drift",
                                                "odometry_random_walk",
                                                "lever_arm",
                                                "wheel_slip",
                                                "moved_landmark",
                                                "label_swap",
                                                "dropout",
                                                "noise_law",
                                                "cell_effect",
                                                "stated_sigma",
                                                "stop_effect",
                                                "autocorrelated_noise",
                                                "heavy_tails",
                                                "early_echo",
                                                "late_return",
                                                "reciprocal_noise",
                                                "temperature_coefficient",
                                                "power_bias",
                                                "covariate_drift",
                                                "device_offset",
                                                "antenna_pattern",
                                                "turn_scale",
                                                "range_saturation",
                                                "scan_latency"};

/// The channels of the file format, and its covariates that are no column.
inline const std::set<std::string> channels{"range",
                                            "bearing",
                                            "stop",
                                            "range_noise",
                                            "bearing_noise",
                                            "range_dependence",
                                            "bearing_dependence",
                                            "range_tail",
                                            "bearing_tail",
                                            "label",
                                            "detection",
                                            "grid"};
inline const std::set<std::string> covariates{"range", "disparity", "sensor_bearing", "heading", "time",
                                              "stop",  "repeat",    "landmark",       "radius",  "constant",
                                              "any"};
/// What an effect along a column has for its covariate in the catalogue.
inline const std::set<std::string> covariates_of_columns{"temperature", "received_power", "column"};

}  // namespace rangecal::test
