// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// 95 % interval [rad] of the direction of a vector mu in the plane that was estimated as x ~ N(mu, C), C scaled by a
/// variance estimated with nu degrees of freedom (infinity: known): the phase of a harmonic from its cosine and sine.
///
///   phi is in it  <=>  (n . x)^2 <= t^2 n^T C n,  n = (sin phi, -cos phi),  x . (cos phi, sin phi) > 0,
///
/// t the 97.5 % quantile of Student's t: the component across phi is not told from 0. These are the lines through the
/// origin that meet the ellipse |L^-1 (z - x)| = t, C = L L^T; with w = L^-1 x its tangents have the directions
///   L R(+-asin(t / |w|)) w,  R a rotation.
/// The limits lie about atan2(x), unwrapped: at most pi apart. None, every direction, where the length is not told from 0
/// at 5 %: |w|^2 <= 2 F_0.95(2, nu) = nu (0.05^(-2 / nu) - 1). Below that the other half of the lines, which the
/// estimate's sign rules out, would take from the coverage. Source: Fieller (1954) for the ratio of the two.
std::optional<Limits> phase_interval(const Eigen::Vector2d& x, const Eigen::Matrix2d& C, double nu);

}  // namespace rangecal::diagnosis
