// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/settled_by.hpp"

#include <algorithm>
#include <array>
#include <string_view>

#include "diagnosis/pairs_design.hpp"

namespace rangecal::diagnosis {
namespace {

/// Of one effect on pairs: codes of the menu, the first that is offered counts, and what to say where none is.
struct SettledOfPairs {
  std::string_view effect;
  std::array<std::string_view, 2> codes;
  std::string_view otherwise;
};

constexpr SettledOfPairs settled_of_pairs[] = {
    {"ambient_light", {"E10"}, {}},
    {"arc_definition", {}, "read the extraction code, and use targets of two or more radii (4 and 12 cm)"},
    {"autocorrelated_noise", {"E7"}, {}},
    {"cell_effect", {"E8"}, {}},
    {"cyclic_error", {}, "move the target by small steps along the line of sight"},
    {"dark_target", {"E6"}, {}},
    {"dropout", {"farther"}, "count missing readings against distance and target"},
    {"heavy_tails",
     {},
     "look where the outliers are: at one distance, on one target, at one time, everywhere"},
    {"landmark_radius", {}, "measure the targets with a calliper"},
    {"lens_distortion", {"E9", "farther"}, "read more often near the sensor"},
    {"mixed_pixels", {}, "use larger targets before an empty background"},
    {"near_regime", {"E9", "denser"}, "record the device's flag as a column"},
    {"noise_law", {"E7"}, {}},
    {"pixel_locking", {"E8"}, {}},
    {"quantisation", {"E7"}, {}},
    {"radius_scale",
     {},
     "measure the targets with a calliper, and use targets of two or more radii (4 and 12 cm)"},
    {"range_eccentricity", {"E1"}, {}},
    {"range_offset",
     {},
     "measure the known distances anew, from the sensor's zero to the target's face: alpha_0 takes an offset up in "
     "every design"},
    {"range_scale",
     {},
     "check the known distances against another tape; where the temperature changes, record it as a column "
     "temperature_c"},
    {"reciprocal_noise", {"E7"}, {}},
    {"target_reflectance", {"E6"}, {}},
    {"tilt", {"E1"}, {}},
    {"warmup_drift", {"cold start", "E12"}, {}},
};

}  // namespace

std::string settled_by(const Rows& rows, const Effect& effect) {
  const EffectInfo& info = effect.info();
  const auto known =
      std::find_if(std::begin(settled_of_pairs), std::end(settled_of_pairs),
                   [&](const SettledOfPairs& one) { return one.effect == id_without_column(info.id); });
  if (!rows.pairs || known == std::end(settled_of_pairs)) return info.settled_by;
  const std::vector<MenuEntry> menu = menu_for_pairs(rows);
  for (const std::string_view code : known->codes)
    for (const MenuEntry& entry : menu)
      if (entry.code == code) return entry.change;
  return known->otherwise.empty() ? info.settled_by : std::string(known->otherwise);
}

}  // namespace rangecal::diagnosis
