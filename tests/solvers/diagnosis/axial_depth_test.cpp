// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "solvers/diagnosis/made_recordings.hpp"

namespace rangecal {
namespace {

using testing::recording_of;
using testing::verdict_of;

TEST(AxialDepth, TakesTheSpreadAlong) {
  // Noise that grows with the depth read, not with the distance: 17 of 25 such recordings got a second name for it.
  int alone = 0;
  constexpr int count = 10;
  for (std::uint64_t seed = 1; seed <= count; ++seed) {
    const Diagnosis d =
        verdict_of(recording_of({.sigma = 0.008, .depth_share = 0.9, .fan_rad = 0.4, .looks_one_way = true},
                                "AxialDepth.Spread", seed));
    if (d.final_effects == std::vector<std::string>{"axial_depth"}) ++alone;
  }
  EXPECT_GE(alone, count - 2);
}

}  // namespace
}  // namespace rangecal
