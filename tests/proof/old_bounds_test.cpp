// SPDX-License-Identifier: BSD-3-Clause
#include "proof/old_bounds.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "proof/rows.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {
namespace {

TEST(OldBounds, SizesByHand) {
  const world::World clean = world::make_turning_design();
  // The bound of settling, 0.0873 rad, was on the yaw at a stop's first reading; a size is the yaw where the robot stops, which is larger.
  const double swing = size_at_old_bounds(clean, "settling", 1, 1.5);
  Random random(1);
  EXPECT_NEAR(world::apply(clean, "settling", swing, random).truth.at("settling.amplitude_rad"), 0.13095,
              1e-6);
  EXPECT_GT(swing, 0.13095);
  // A tilt's bound was on its square: sqrt(2 x 0.0305 rad^2) = 0.24698 rad.
  EXPECT_NEAR(size_at_old_bounds(clean, "tilt", 1, 2.0), 0.24698, 1e-4);
  // The simulator takes 0.0873 rad over the run for plausible, 1.666 times 0.0524 rad.
  EXPECT_NEAR(most_old_bounds(clean, "bearing_drift", 1), 1.666, 1e-3);
  EXPECT_EQ(size_at_old_bounds(clean, "bearing_drift", 1, 3.0), 0.0873);
  EXPECT_EQ(most_old_bounds(clean, "heavy_tails", 1), 0.0);
}

TEST(OldBounds, AreThoseOfParametersThatTheSimulatorHas) {
  const world::World clean = world::make_turning_design();
  for (const world::EffectInfo& info : world::effect_table()) {
    if (!info.catalogued || info.effect_class != world::EffectClass::mean) continue;
    SCOPED_TRACE(info.id);
    ASSERT_FALSE(old_bounds(info.id).empty());
    Random random(4);
    const double times = in_old_bounds(world::apply(clean, info.id, info.typical, random), info.id);
    EXPECT_GT(times, 0.0);
    EXPECT_LT(times, 1.0);  // what is typical was within what was looked for
  }
}

TEST(Large, IsOneToThreeTimesTheBoundsOfOld) {
  for (int index = 0; index < 12; ++index) {
    const Case c = draw_case("large", 9, index, index % 2 == 0 ? "line" : "turning");
    SCOPED_TRACE(c.truth.at(0));
    const double times = in_old_bounds(c.planted, c.truth.at(0));
    EXPECT_GE(times, 1.0 - 1e-6);
    EXPECT_LE(times, 3.0 + 1e-6);
    EXPECT_GE(c.value, 100.0);
    EXPECT_EQ(c.sizes, draw_case("large", 9, index, c.design).sizes);
  }
}

}  // namespace
}  // namespace rangecal::proof
