// SPDX-License-Identifier: BSD-3-Clause
// Radii that are estimated: what a whole extraction makes of them.
#include <gtest/gtest.h>

#include <cmath>
#include <cstdint>
#include <iterator>
#include <utility>
#include <vector>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/scans.hpp"
#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal {
namespace {

/// Four cylinders of one radius in a room, 20 scans of half-degree beams from each of six stops; an ideal sensor.
world::World four_cylinders(double radius_m, double sigma_m) {
  world::World world = world::make_line_design();
  world.sensor = world::OpticalSensor();
  world.noise.speckle_per_m = 0.0, world.noise.floor_m = sigma_m;
  world.timing.repeats = 20;
  const double stops[][3] = {{0.0, 0.0, 0.0}, {0.4, 0.1, 0.2},   {0.8, 0.0, -0.3},
                             {0.2, 0.3, 0.5}, {-0.3, -0.1, 1.0}, {-0.2, -0.5, 2.0}};
  const double axes[][2] = {{1.0, 1.0}, {-1.2, 0.8}, {0.2, -1.3}, {1.5, -0.9}};
  world.robot.stops.resize(std::size(stops));
  for (std::size_t k = 0; k < std::size(stops); ++k)
    world.robot.stops[k].commanded = {stops[k][0], stops[k][1], stops[k][2]};
  world.landmarks.resize(std::size(axes));
  for (std::size_t j = 0; j < std::size(axes); ++j) {
    world::Cylinder& cylinder = world.landmarks[j];
    cylinder.x_m = axes[j][0], cylinder.y_m = axes[j][1];
    cylinder.radius_m = cylinder.nominal_radius_m = radius_m;
  }
  return world;
}

Extraction extracted(const world::World& world, std::vector<double> radii, std::uint64_t seed) {
  world::ScanScene scene;
  scene.walls = {{-3, -3, 4, -3}, {4, -3, 4, 4}, {4, 4, -3, 4}, {-3, 4, -3, -3}};
  scene.step_rad = 0.00872664626, scene.beams = 720;
  ExtractOptions options;
  options.cylinder.radii_m = std::move(radii);
  options.association.sigma_xy_m = world.robot.stated_sigma_m;
  options.association.sigma_heading_rad = world.robot.stated_heading_sigma_rad;
  return extract_recording({simulate_scans(world, scene, seed).log}, world.robot.stops, options);
}

// 24 radii: their errors over their standard deviations have a mean of 0 +- 1 / sqrt(24) = 0.204, a mean square of 1 +-
// sqrt(2 / 24) = 0.289. Four of these are allowed and 0.3 more: scans in which a cylinder happens to look flat are refused.
// Means weighted by the variance of each arc's own radius are 2 and 5 mm low, five and ten standard deviations.
TEST(ExtractRadius, ThatIsEstimatedIsNotLowAndSaysHowSureItIs) {
  double sum = 0.0, squares = 0.0;
  int count = 0;
  for (const double radius : {0.1, 0.06})
    for (std::uint64_t seed = 0; seed < 3; ++seed) {
      const world::World world = four_cylinders(radius, 0.004);
      const Extraction extraction =
          extracted(world, {}, seed_from("ExtractRadius", {static_cast<std::uint64_t>(1e3 * radius), seed}));
      ASSERT_EQ(extraction.recording.landmarks.size(), 4u) << radius << " " << seed;
      ASSERT_EQ(extraction.radius_sd_m.size(), 4u);
      for (std::size_t j = 0; j < 4; ++j) {
        const double sd = extraction.radius_sd_m[j],
                     z = (extraction.recording.landmarks[j].radius_m - radius) / sd;
        EXPECT_GT(sd, 1e-4) << radius << " " << seed;
        EXPECT_LT(sd, 1.2e-3) << radius << " " << seed;
        sum += z, squares += z * z, ++count;
      }
    }
  EXPECT_LT(std::abs(sum / count), 0.3 + 4.0 * 0.204);
  EXPECT_LT(squares / count, 1.3 + 4.0 * 0.289);
}

TEST(ExtractRadius, ThatIsStatedHasNoStandardDeviation) {
  const Extraction extraction =
      extracted(four_cylinders(0.1, 0.002), {0.1}, seed_from("ExtractRadius.Stated"));
  EXPECT_EQ(extraction.radius_sd_m, std::vector<double>(4, 0.0));
}

}  // namespace
}  // namespace rangecal
