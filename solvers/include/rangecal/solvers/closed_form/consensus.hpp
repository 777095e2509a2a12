// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"

namespace rangecal {

/// Readings of a recording that agree with where most lines of sight and ranges put their landmark.
struct Consensus {
  /// The cells of the readings that agree: what the closed forms' robust version is the closed form of.
  JointProblem problem;
  std::vector<char> kept;  ///< per row of the problem asked about
  /// Per row: the landmark that a reading left out agrees with in place of its own, in range and bearing both (a wrong
  /// label, most likely); -1: none.
  std::vector<int> fits_landmark;
  int left_out = 0;
};

/// The robust weight of the closed forms (2021, eq. 18-28): 1 for a reading within six robust spreads of its
/// landmark's consensus in range and in bearing, else 0. Of readings without outliers none is left out but one
/// in 10^8, and the closed forms are the paper's own.
///
///   1. Each landmark starts at the median of stop + (y + radius) (cos phi, sin phi), x and y for themselves.
///   2. Lines of sight: angle a_i between line and landmark as seen from the commanded stop, of variance
///      v_i + tau^2, v_i what the errors of the stop make of it; tau from the median of a^2 / (v + tau^2) over all
///      lines, 0.455; landmarks by (2021, eq. 18-23) with Tukey's biweight of a / sqrt(v + tau^2), until they rest.
///   3. Ranges: y - f(d) at these landmarks, f of order 2 by the same biweight, of variance v_i + tau^2 d^(2p),
///      p = 0, 1 or 2 by likelihood.
///
/// Of ranges alone the landmarks are those of landmarks_from_ranges, and step 3 follows at once.
///
/// A landmark of which less than 60 % would be kept has no consensus: all of it is kept. `rows`: Grouping::rows.
/// Source: Hampel, Ronchetti, Rousseeuw, Stahel, Robust Statistics, 1986 (biweight, median start).
/// Cost: linear in the rows, some 30 passes.
Consensus find_consensus(const JointProblem& rows);

/// The same of readings at known distances [m] (2016): step 3 with f of order up to 4 and exact distances. A stretch of
/// distances, one in up to 20 of as many readings, of which less than 60 % would be kept has no consensus: all of it is
/// kept, as where no polynomial goes through. Cost: linear in the readings but for their order by distance.
std::vector<char> agreeing_pairs(std::span<const double> true_m, std::span<const double> reading_m);

}  // namespace rangecal
