// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// 95 % interval of the length r = |mu| of a vector in the plane that was estimated as x ~ N(mu, C), R = |x|:
///
///   low:  P(|x| >= R | r) = 2.5 %,  0 where that is more at r = 0 already;   high: P(|x| <= R | r) = 2.5 %
///
/// An amplitude made of a cosine and a sine is such a length. Its estimate is never 0 and lies above r while
/// r is below a few standard deviations (E R^2 = r^2 + tr C), so that the interval R +- 1.96 sd holds a small
/// r too seldom, and 0 never. For C = s^2 I, R / s has Rice's law and the interval covers 95 % exactly, 97.5
/// % at r = 0; else mu has the direction that is likeliest at its length. Source: Rice (1945), inverted as a
/// test; for C our derivation.
Limits length_interval(const Eigen::Vector2d& x, const Eigen::Matrix2d& C);

/// P(|x| <= R), x ~ N(mu, C).
double probability_within(double R, const Eigen::Vector2d& mu, const Eigen::Matrix2d& C);

}  // namespace rangecal::diagnosis
