// SPDX-License-Identifier: BSD-3-Clause
#include "proof/any_design.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include "proof/rows.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::proof {
namespace {

bool is_straight(const world::World& world) {
  const std::vector<Stop>& stops = world.robot.stops;
  return std::all_of(stops.begin(), stops.end(), [&](const Stop& stop) {
    return std::abs(stop.commanded.heading_rad - stops.front().commanded.heading_rad) < 1e-9;
  });
}

TEST(AnyDesign, StaysWithinWhatIsSaid) {
  std::set<std::size_t> landmarks, stops;
  std::set<int> repeats;
  int straight = 0;
  constexpr int worlds = 600;
  for (int i = 0; i < worlds; ++i) {
    Random random(seed_from("any_design", {static_cast<std::uint64_t>(i)}));
    world::World world = any_design(random);
    landmarks.insert(world.landmarks.size());
    stops.insert(world.robot.stops.size());
    repeats.insert(world.timing.repeats);
    straight += is_straight(world);
    EXPECT_EQ(world.robot.stated_sigma_m, world.robot.placing_sigma_m);
    EXPECT_EQ(world.robot.stated_heading_sigma_rad, world.robot.heading_sigma_rad);
    EXPECT_TRUE(world.planted.empty());
    for (const Stop& stop : world.robot.stops)
      for (const world::Cylinder& landmark : world.landmarks) {
        const double away = std::hypot(landmark.x_m - stop.commanded.x_m, landmark.y_m - stop.commanded.y_m);
        EXPECT_GE(away - landmark.radius_m, 0.35);
        EXPECT_LE(away, 8.0);  // no reading is lost beyond the sensor's 12 m
      }
  }
  // Every number of landmarks and repeats comes, and 52 of 56 or more numbers of stops; a third of the paths are straight.
  EXPECT_EQ(landmarks.size(), 10u);
  EXPECT_EQ(*landmarks.begin(), 3u);
  EXPECT_EQ(*landmarks.rbegin(), 12u);
  EXPECT_EQ(repeats.size(), 30u);
  EXPECT_GE(*stops.begin(), 5u);
  EXPECT_LE(*stops.rbegin(), 60u);
  EXPECT_GE(stops.size(), 52u);
  EXPECT_NEAR(straight, worlds / 3, 60);
}

TEST(CleanAny, SameSeedSameWorld) {
  const Case a = draw_case("clean-any", 7, 3, "line"), b = draw_case("clean-any", 7, 3, "line"),
             c = draw_case("clean-any", 8, 3, "line");
  EXPECT_TRUE(a.truth.empty());
  EXPECT_EQ(record(a, a.planted).readings.range_m, record(b, b.planted).readings.range_m);
  EXPECT_NE(record(a, a.planted).readings.range_m, record(c, c.planted).readings.range_m);
  EXPECT_EQ(record(a, a.planted).readings.size(), a.clean.landmarks.size() * a.clean.robot.stops.size() *
                                                      static_cast<std::size_t>(a.clean.timing.repeats));
  EXPECT_LT(a.value, 1.0);  // the seed model holds it
}

}  // namespace
}  // namespace rangecal::proof
