// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <string>
#include <vector>

#include "diagnosis/battery.hpp"

namespace rangecal::diagnosis {

/// What the bookkeeping found: mistakes in labels, grids and missing readings, which look like physics.
struct Bookkeeping {
  Model model;                     ///< effects found, with their parameters
  std::vector<Question> findings;  ///< channel, covariate, evidence
  bool coarse = true;              ///< its grids may exceed the scatter of repeats: spreads then say nothing
  std::vector<std::string> notes;
  double step_beyond_noise_m = 0.0;  ///< of a grid so coarse that repeats are alike (grids.hpp), else 0
};

constexpr double certain = -200.0;  ///< ln p of what cannot happen under the seed model

/// The finding of a mistake in labels, a grid or missing readings, of which chance makes one with probability exp(log_p).
Question bookkeeping_question(const char* channel, const char* covariate, const char* shape, double log_p);

/// Readings that sit on a grid coarse against their spread, and readings that are missing in dependence on
/// distance.
Bookkeeping find_grids_and_gaps(const Rows& rows);

/// Adds the grid of pairs without repeats that is coarse against the spread of the quietest tenth of the readings, as a fit has
/// them: what causes did to the readings had hidden it. False if there is none, or one was known.
bool add_grid_beside(const Rows& rows, const Fit& fit, Bookkeeping& known);

/// Takes grids off whose steps are less than a fifteenth of the spread of most readings, as a fit has it: they stand out in cells
/// that scatter less than the model says, and cost nothing. A note says what they are. False if there is none.
bool drop_fine_grids(const Rows& rows, const Fit& fit, Bookkeeping& known);

/// Kinds of effects that bookkeeping finds, not scores.
inline bool is_bookkeeping(EffectKind kind) {
  return kind == EffectKind::grid || kind == EffectKind::label || kind == EffectKind::detection;
}

}  // namespace rangecal::diagnosis
