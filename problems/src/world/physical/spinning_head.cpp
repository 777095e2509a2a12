// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/physical/spinning_head.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/angles.hpp"

namespace rangecal::world {
namespace {

/// Angle counted by a disc whose centre is carried round off the spin axis, read at a fixed place on the rim.
double read_eccentric_disc(const SpinningHead& head, double angle) {
  if (head.disc_offset_mm == 0.0) return angle;
  const double towards = angle - head.disc_phase_rad;
  const double x = head.encoder_radius_mm - head.disc_offset_mm * std::cos(towards);
  const double y = -head.disc_offset_mm * std::sin(towards);  // read head seen from the centre of the disc
  return angle - std::atan2(y, x);
}

/// Angle counted on graduation lines that were printed on a ring stretched by (1 + stretch) along one
/// direction.
double read_stretched_ring(const SpinningHead& head, double angle) {
  if (head.ring_stretch == 0.0) return angle;
  const double from_axis = angle - head.ring_phase_rad;
  const double s = std::sin(from_axis), c = std::cos(from_axis);
  const double printed = std::atan2((1.0 + head.ring_stretch) * s, c);
  return angle + wrap_angle(printed - from_axis);
}

}  // namespace

double encoder_reading_rad(const SpinningHead& head, double beam_rad, double time_s) {
  // The index pulse lies behind; the count since then is scaled, and forward was adjusted to read 0.
  const double since_index = wrap_angle(beam_rad) + std::numbers::pi;
  double angle = (since_index - std::numbers::pi) * (1.0 + head.gear_error);
  angle = read_eccentric_disc(head, angle);
  angle = read_stretched_ring(head, angle);
  angle += head.beam_squint_rad + head.zero_rad + head.zero_creep_rad_per_s * time_s;
  return wrap_angle(angle);
}

double cover_path_m(const SpinningHead& head, double beam_rad) {
  if (head.cover_offset_m == 0.0) return 0.0;
  // From the spin axis along the beam to a ring of radius rho whose centre is off by e.
  const double along = head.cover_offset_m * std::cos(beam_rad - head.cover_phase_rad);
  const double across = head.cover_offset_m * std::sin(beam_rad - head.cover_phase_rad);
  return along + std::sqrt(head.cover_radius_m * head.cover_radius_m - across * across) - head.cover_radius_m;
}

double swing_rad(const SpinningHead& head, double since_stop_s) {
  if (head.swing_rad == 0.0) return 0.0;
  // theta'' + (1/T1 + 1/T2) theta' + theta / (T1 T2) = 0, theta(0) = A, theta'(0) = 0, with T2 = T1 / 20.
  const double slow = head.swing_time_s, fast = slow / 20.0;
  const double t = std::max(0.0, since_stop_s);
  return head.swing_rad * (slow * std::exp(-t / slow) - fast * std::exp(-t / fast)) / (slow - fast);
}

double centre_of_hits_rad(const SpinningHead& head, double centre_rad, double half_width_rad,
                          double low_error_rad, double high_error_rad) {
  if (!(head.beam_grid_rad > 0.0)) return wrap_angle(centre_rad + 0.5 * (low_error_rad + high_error_rad));
  const double step = head.beam_grid_rad, phase = head.beam_grid_phase_rad;
  const double first = std::ceil((centre_rad - half_width_rad + low_error_rad - phase) / step);
  const double last = std::floor((centre_rad + half_width_rad + high_error_rad - phase) / step);
  const double middle = first <= last ? 0.5 * (first + last) : std::round((centre_rad - phase) / step);
  return wrap_angle(phase + step * middle);
}

}  // namespace rangecal::world
