// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// What the encoder says [rad, wrapped] when the beam points to beam_rad at the given time.
double encoder_reading_rad(const SpinningHead& head, double beam_rad, double time_s);

/// Path that the eccentric ring adds when the beam points to beam_rad [m].
double cover_path_m(const SpinningHead& head, double beam_rad);

/// Yaw left t seconds after the robot stopped: a heavily damped swing released at rest [rad].
double swing_rad(const SpinningHead& head, double since_stop_s);

/// Centre of first and last hit among beams on a grid, for edges at centre -+ half_width whose detection is
/// off by low_error and high_error [rad]. Without a grid: centre + mean of the two errors.
double centre_of_hits_rad(const SpinningHead& head, double centre_rad, double half_width_rad,
                          double low_error_rad, double high_error_rad);

}  // namespace rangecal::world
