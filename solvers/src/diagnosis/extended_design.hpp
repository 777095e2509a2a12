// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <string>
#include <vector>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// This recording extended by one change of the experiment: its readings stay, the new ones stand where the
/// estimate predicts them. What happened at a stop or to a landmark still happens there. Of pairs, what is read anew
/// is a batch of its own for every cell that it repeats, and a stop is a cell.
struct ExtendedDesign {
  Rows rows;
  JointState state;
  int stop_factor = 1;  ///< the stop of index k is now the one of index k * stop_factor
  std::vector<std::vector<int>>
      copies;                 ///< per landmark: the indices under which it stands now (exchanged: two)
  double drift_factor = 1.0;  ///< duration over the old one: effects that grow with scaled time grow by it
  std::set<std::string> switched_off;  ///< effects that do not act on the new readings
  int first_new_stop = -1;             ///< from here on, where effects are switched off
  bool adds_times = false;  ///< to a recording without: its readings, whose times nobody knows, are left out
  std::string varies;       ///< the covariate column that the change varies; empty: none
};

struct MenuEntry {
  std::string code, change;
};
/// The changes that apply to this recording. Of pairs the cheapest come first; a change that takes a column which the
/// recording lacks says so.
std::vector<MenuEntry> menu_for(const Rows& rows);

/// Throws std::invalid_argument for a code that is not on the menu.
ExtendedDesign extend(const Rows& rows, const JointState& state, const std::string& code);

/// Ids of the effects that a change of the experiment takes away.
std::set<std::string> effects_without(const std::string& code);

/// A model's effects with discrete parameters (stops) and drifts as the extended design counts them. Effects
/// of a landmark that stands under two indices appear once for each. A grid that is switched off is so everywhere: the
/// old readings tell less than new ones without it.
Model in_design(const ExtendedDesign& design, const Model& model);

}  // namespace rangecal::diagnosis
