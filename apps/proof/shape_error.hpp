// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::proof {

/// A law whose shape is a tenth off. With u the change of the mean readings that an effect makes, range and bearing, each
/// divided by its standard deviation, every reading's change becomes
///
///   u (1 + e),   e = k (g - c),   c = (u . g u) / |u|^2,   k = 0.1 |u| / |(g - c) u|,
///
/// so that e u is at a right angle to u, which is no change of size, and its RMS over the readings is a tenth of that of u.
/// g is smooth in the covariate x of the effect's law:
///   distance, time, repeat   sum of a_j P_j(x), j = 1 .. 3, P_j Legendre, x scaled to -1 .. 1
///   sensor bearing, heading  sum of a_j cos j x + b_j sin j x, j = 1 .. 3;     a_j, b_j ~ N(0, 1 / j^2)
///
/// Source: derived.
constexpr double shape_off = 0.1;

/// Differences of the mean readings of two worlds, in the order of world::Expected: ranges [m], then bearings [rad].
Eigen::VectorXd change_of_means(const world::Expected& to, const world::Expected& from);

/// e of every reading in the order of world::expected, one for its range and its bearing, for effect `id` in `planted`. The
/// covariate is the first of world::EffectInfo::covariates, the distance where that is a landmark or nothing at all, or where it
/// is the same for all readings that change.
std::vector<double> shape_error(const world::World& clean, const world::World& planted, const std::string& id,
                                Random& random);

/// Adds e times the change to a recording that world::simulate(planted, seed) made: the change is that at the recording's
/// own stops, the noise is left as it is.
void add_shape_error(Recording& recording, const world::World& clean, const world::World& planted,
                     const std::vector<double>& error, std::uint64_t seed);

}  // namespace rangecal::proof
