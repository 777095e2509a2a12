// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::world {

/// What an effect changes.
enum class EffectClass { mean, noise, dependence, tail, label, detection, grid, absorbed };
/// "mean", "noise", ...
const char* to_string(EffectClass effect_class);

/// One departure that can be planted.
struct EffectInfo {
  std::string id;
  std::string unit;                     ///< of `size`
  double typical = 0.0, maximum = 0.0;  ///< maximum: beyond it the world is no longer plausible
  EffectClass effect_class = EffectClass::mean;
  std::vector<std::string> channels;  ///< where its mismatch may be located, best first (docs/formats.md)
  std::vector<std::string> covariates;
  bool catalogued = true;  ///< false: outside the catalogue, no name may be given
  std::string physics;     ///< what is changed in the world
};

/// Every effect, catalogued ones first.
const std::vector<EffectInfo>& effect_table();
/// The entry of one effect. Throws InputError for an unknown id, naming it.
const EffectInfo& effect_info(std::string_view id);

/// The world with one departure more, of the given size (unit of effect_info). What the size leaves open
/// (phases, which landmark, which stop, time constants) is drawn from `random`. The parameters are recorded
/// in World::truth, the plant in World::planted. Throws InputError for an unknown id or a size that is not
/// finite or lies beyond the maximum.
World apply(const World& world, std::string_view effect_id, double size, Random& random);

}  // namespace rangecal::world
