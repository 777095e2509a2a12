// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// Which optima of a likelihood with several modes are looked at.
enum class ModeSearch {
  all,     ///< every mode that its readings allow
  nearest  ///< the local optimum downhill from where it is
};

/// Moves each place to the most likely of the several modes that its readings allow.
///
/// An effect h(d) [m] that oscillates with distance, of amplitude A, its slope near 1 or above, makes the
/// reading f(d) + h(d) go up and down: one reading, several distances d. A solve of stops keeps the mode in
/// which it started. The sum over the cells seen from a place, at position error u [m] from where it is,
///   sum w (y - f(d(u)) - h(d(u)))^2 / (2 s^2) + bearings + prior     [nats]
/// is looked up on a grid of u that is finer than a period and as wide as what the readings, A counted as an
/// error of theirs, leave open, 2.5 periods to either side at most, and from there downhill; the place is moved
/// where that gains. Landmarks, curve and headings stay. Places that are exact, or whose errors add up along a walk,
/// stay. False: all did.
bool move_places_to_modes(const Rows& rows, const Model& model, const WorkingCells& working,
                          ModeSearch search, JointState& state);

/// Puts places, after a solve from `before` that took effects for straight lines, into the optimum downhill from where it put
/// them, or from where they were, whichever is likelier; those alone that the lines took elsewhere than the effects do. `sides`:
/// on which readings stay. False: all stayed.
bool follow_oscillation(const Rows& rows, const Model& model, const WorkingCells& working_before,
                        const JointState& before, const WorkingCells& working, const Sides* sides,
                        JointState& state);

}  // namespace rangecal::diagnosis
