// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/settled_by.hpp"

#include "diagnosis/pairs_design.hpp"

namespace rangecal::diagnosis {

std::string settled_by(const Rows& rows, const Effect& effect) {
  const EffectInfo& info = effect.info();
  const SettledOfPairs& pairs = info.settled_of_pairs;
  if (!rows.pairs || (pairs.changes.empty() && pairs.otherwise.empty())) return info.settled_by;
  const std::vector<MenuEntry> menu = menu_for_pairs(rows);
  for (const std::string& code : pairs.changes)
    for (const MenuEntry& entry : menu)
      if (entry.code == code) return entry.change;
  return pairs.otherwise.empty() ? info.settled_by : pairs.otherwise;
}

}  // namespace rangecal::diagnosis
