// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>

#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// A recording of the scene by the seed model (Alhashimi 2021, eq. 1-8), with its ground truth.
///
/// Measured, for stop k with true pose (p_k, h_k) and landmark l with axis m_l:
///   d     = |m_l - p_k| - radius_l                        true distance to the surface [m]
///   y     = f(d) + s(d) e,   e ~ N(0, 1)                  reading [m]
///   theta = atan2(m_l - p_k) - h_k + nu,  nu ~ N(0, sigma_theta^2)   bearing [rad], wrapped to (-pi, pi]
///   p_k   = commanded + (e_x, e_y), each N(0, sigma_s^2); h_k = commanded + N(0, sigma_h^2)
/// Stops of one place share (e_x, e_y). Random walk: the errors add to the increment from the stop before, in that
/// stop's frame. For pairs: y = f(d) + s(d) e at the distances of the batches.
///
/// With optics (sensor model `optical`) f(d) and theta are those of the physical world's sensor and head, looking at the
/// landmarks as cylinders; s(d) e is added to the range (optical_sensor.hpp, expose()). Ideal optics: f(d) = d.
///
/// A reading that is not positive or lies outside the sensor's range is lost and counted; a cell (or batch) that
/// loses more than 1 % of its readings at a limit of the range is left out whole, as load_recording does.
///
/// The same scene and seed give the same recording. Stops, placement of landmarks, tapes and readings draw from
/// streams of their own. Throws InputError where the scene cannot be simulated (no spread, no room for a landmark), and for
/// effects, which simulate_scene() of the solvers draws.
/// Cost: linear in the readings.
Recording simulate(const Scene& scene, std::uint64_t seed);

}  // namespace rangecal
