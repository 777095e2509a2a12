// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>

#include "rangecal/core/curve_scale.hpp"

namespace rangecal {

struct SmoothingSpline {
  CurveScale scale;
  double level = 0.0, factor = 1.0;  ///< the curve is level + factor u(d)
  bool stiffened = false;            ///< the likeliest one turns, or nearly
};

/// A smooth curve that rises or falls everywhere, as the scale of which the readings are a line: readings y_i at distances d_i [m], of
/// variance sigma^2 / w_i, about g(d_i) with a natural cubic spline g of values g at knots,
///
///   g-hat = argmin sum w_i (y_i - N_i^T g)^2 + lambda g^T P g,   C = sigma^2 (A + lambda P)^-1,   A = sum w_i N_i N_i^T
///
/// with N_i of NaturalSpline and g^T P g its roughness. lambda and sigma^2 maximise the restricted likelihood of the model that this is
/// the best predictor of, in which straight lines have a flat prior and what bends them a normal one: they minimise
///
///   (n - 2) log sigma^2 + log |A + lambda P| - (knots - 2) log lambda,   sigma^2 = (least sum) / (n - 2)
///
/// Where that curve turns, or its slope falls below a thousandth of the mean, lambda is raised to where it no longer does. The scale u is
/// g-hat less its value at 0 (straight on from the first knot), over its mean slope; its covariance is C, in these units, without what a
/// line in u takes up by least squares weighted with A.
/// Source: Wahba 1985; Green and Silverman 1994, section 3; Wood 2011 (degrees of freedom: tr (A + lambda P)^-1 A).
///
/// Knots: some 40 at equal shares along the curve, by distances and by readings alike, or all distances where they are fewer.
/// `weights`: w_i; empty: 1. None where there are fewer than 5 different distances or 6 readings, where readings do not change from the
/// nearest to the farthest, and where weights differ by more than a factor of 1e10. Cost: linear in the readings.
std::optional<SmoothingSpline> smoothing_spline(std::span<const double> true_m,
                                                std::span<const double> reading_m,
                                                std::span<const double> weights = {});

}  // namespace rangecal
