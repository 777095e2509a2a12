// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// How far a place may be from where it is looked for.
enum class Swings {
  all,  ///< every position that its readings leave open
  own   ///< downhill from where it is
};

/// Puts each place where its readings are most likely, of the several positions that they allow.
///
/// An effect h(d) [m] that swings with distance by an amplitude A, its slope near 1 or above, makes the
/// reading f(d) + h(d) go up and down: one reading, several distances d. A solve of stops keeps the swing on
/// which it started. The sum over the cells seen from a place, at position error u [m] from where it is,
///   sum w (y - f(d(u)) - h(d(u)))^2 / (2 s^2) + bearings + prior     [nats]
/// is looked up on a grid of u that is finer than a swing and as wide as what the readings, A counted as an
/// error of theirs, leave open, 2.5 swings to either side at most, and from there downhill; the place is moved
/// where that gains. Landmarks,
/// curve and headings stay. Places that are exact, or whose errors add up along a walk, stay. False: all did.
bool settle_places(const Rows& rows, const Model& model, const WorkingProblem& working, Swings swings,
                   JointState& state);

}  // namespace rangecal::diagnosis
