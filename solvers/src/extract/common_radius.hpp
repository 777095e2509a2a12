// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "rangecal/solvers/extract/circle_fit.hpp"

namespace rangecal::extract {

/// A landmark in one scan.
struct Arc {
  std::vector<Beam> beams;  ///< its hits, without mixed pixels
  Outline outline;          ///< where its axis is without its ranges
  double range_m = 0.0;     ///< nearest point, of a first fit
  double sigma_m = 0.0;     ///< standard deviation of one beam
};

struct RadiusLimits {
  double edge_cut = 0.9;  ///< hits that pass the axis at more than this share of R are left out
  double least_m = 0.02, most_m = 0.2;
};

struct RadiusEstimate {
  double radius_m = 0.0;
  double sd_m = 0.0;  ///< 0 where the radius was stated
};

/// The radius R [m] of a landmark from all its arcs at once, each with a nearest range s and an axis b of its own:
///
///   r = mu(s, b, R) + N(0, sigma^2)                                     mu: arc_point
///   sum over arcs of  g^T (r - mu + c) / sigma^2 = 0                    the score of R that s and b cannot take
///   g = J_R - J (J^T J)^-1 J^T J_R,   J = (J_s, J_b),   c = tr(H C) / 2,   C = sigma^2 (J^T J)^-1
///
/// H: second derivatives of mu by (s, b). c is what an axis that is not known exactly adds to the mean (Box, J. R. Stat.
/// Soc. B 33, 1971); without it R has a bias that no number of arcs averages out. 1 / sd^2 is the sum of g^T g / sigma^2; sd is
/// widened by sqrt(chi^2 / degrees of freedom) where that is above 1. The outlines are left out of
/// the score: the beams' grid moves both them and g, at a stop in all scans alike.
///
/// A mean of the arcs' own radii is no substitute: 1 / R has an even error, of relative variance v say, and the stated
/// variance goes with R^4. Weighted by it E R = R (1 - 3 v), unweighted R (1 + v).
///
/// Hits are chosen about an axis that knows nothing of the scan's own ranges, or those that happen to reach far would
/// choose themselves: the weighted mean of its outline and of the arcs of the stop's other scans.
///
/// `stops`: the arcs of each stop; `start_m`: a first guess. Nothing where R leaves its limits or does not settle, and where
/// no arc has three hits inside its edges. Cost: linear in the hits, some 5 passes.
std::optional<RadiusEstimate> common_radius(const std::vector<std::vector<Arc>>& stops, double start_m,
                                            const RadiusLimits& limits);

}  // namespace rangecal::extract
