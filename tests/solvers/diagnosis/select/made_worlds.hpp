// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <utility>
#include <vector>

#include "diagnosis/search.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

/// Worlds of the physical simulator with several causes in them, and what the search starts from.
namespace rangecal::testing {

using Planted = std::vector<std::pair<std::string, double>>;

/// The turning design with each effect at its size (unit of world::effect_info).
inline Recording recording_with(const Planted& planted, const std::string& name) {
  Random random(seed_from(name, {1}));
  world::World world = world::make_turning_design();
  for (const auto& [id, size] : planted) world = world::apply(world, id, size, random);
  return world::simulate(world, seed_from(name, {2}));
}

/// The seed model fitted to a recording.
struct SeedFit {
  explicit SeedFit(const Recording& recording) : rows(diagnosis::make_rows(std::span(&recording, 1))) {
    fit = diagnosis::fit_baseline(rows, {}, options);
  }
  diagnosis::Rows rows;
  diagnosis::RefitOptions options;
  diagnosis::Fit fit;
};

}  // namespace rangecal::testing
