// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rangecal/problems/world/physical/world.hpp"

namespace rangecal::proof {

/// How far the catalogue of commit b621615 looked for one parameter of an effect.
struct OldBound {
  const char* parameter;  ///< as World::truth names it
  double bound;           ///< in the parameter's unit
  int power = 1;          ///< the parameter grows by this power of the plant's size
};

/// Those of one effect; empty for effects that had none, or that change no mean.
std::vector<OldBound> old_bounds(const std::string& id);

/// How many times its old bounds an effect in a world is: the length of its parameters, each divided by its bound.
double in_old_bounds(const world::World& planted, const std::string& id);

/// The most times that the simulator can show within the plant's physical maximum; 0 without an old bound. What the size leaves
/// open is drawn from `effect_seed`.
double most_old_bounds(const world::World& clean, const std::string& id, std::uint64_t effect_seed);
/// The size of the plant (unit of world::effect_info) that is so many times the old bounds, at most `most_old_bounds`.
double size_at_old_bounds(const world::World& clean, const std::string& id, std::uint64_t effect_seed,
                          double times);

}  // namespace rangecal::proof
