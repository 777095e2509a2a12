// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

namespace rangecal {

/// A squared residual of a cell mean, with variance x * scale + other: x unknown, the rest known.
struct MomentTerm {
  double residual_sq = 0.0, scale = 1.0, other = 0.0;
};

/// The x > 0 at which the squared residuals are what they should be:
///   sum_i residual_sq_i / (x scale_i + other_i) + within / x = dof,
/// `within` the sum of scaled squares about the cell means (variance x). The left side falls with x, so there
/// is one root or none. Returns 0 where `other` alone explains the residuals, or dof <= 0. (A Paule-Mandel
/// estimate; with other = 0 and within = 0 it is the weighted residual sum of squares over its degrees of
/// freedom.)
double variance_from_moments(const std::vector<MomentTerm>& terms, double within, double dof);

/// Standard deviation of that root where the terms are weighted by their variances' inverse, as lines of sight are (about a
/// curve of other weights: residual_spread.hpp): the left side has variance 2 dof + 4 `shared` where every term has its
/// expectation, `shared` the sum over pairs of terms of their squared correlation, and falls by
///   dof_within / x + sum_i scale_i / (x scale_i + other_i)
/// per unit of x, parameters that were fitted along taking their share of both.
double std_dev_from_moments(const std::vector<MomentTerm>& terms, double shared, double dof_within,
                            double dof, double x);

}  // namespace rangecal
