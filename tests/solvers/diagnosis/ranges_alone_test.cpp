// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"

namespace rangecal {
namespace {

/// A radio that reads ranges alone, on a round of 24 stops among five anchors.
std::string radio(const std::string& effects) {
  std::string text =
      "format: rangecal-scene/1\n"
      "sensor: {alpha: [0.05, 1.02], noise: {law: constant, sigma: 0.02}, sigma_theta_rad: none, range_min_m: 0.1, range_max_m: 20}\n"
      "timing: {drive_s: 20, sweep_s: 0.2}\n"
      "repeats: 8\n"
      "landmarks: {radius_m: 0, list: [{landmark: A, x_m: -5, y_m: -4}, {landmark: B, x_m: 6, y_m: -3}, {landmark: C, x_m: 5, y_m: 6}, "
      "{landmark: D, x_m: -4, y_m: 5}, {landmark: E, x_m: 0.5, y_m: 0.3}]}\n"
      "stops:\n  sigma_xy_m: 0.01\n  list:\n";
  for (int k = 0; k < 24; ++k) {
    const double angle = 2.0 * 3.14159265358979 * k / 24.0, radius = 2.5 + std::sin(3.0 * angle);
    text += "    - {stop: s" + std::to_string(k) + ", x_m: " + std::to_string(radius * std::cos(angle)) +
            ", y_m: " + std::to_string(radius * std::sin(angle)) +
            ", heading_rad: " + std::to_string(0.9 * k - 6.28 * (k / 7)) + "}\n";
  }
  return text + effects;
}

Diagnosis diagnosed(const std::string& effects, std::uint64_t seed) {
  const Recording recording = simulate_scene(parse_scene(radio(effects), "radio", SceneScope::any), seed);
  return diagnose({&recording, 1});
}

TEST(RangesAloneDiagnosed, ACleanRecordingHasNoMismatchAndNoBearings) {
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed) {
    const Diagnosis d = diagnosed("", seed);
    alarms += d.verdict != Verdict::no_mismatch;
    EXPECT_FALSE(d.baseline.sigma_theta_rad);
    for (const Finding& finding : d.location)
      EXPECT_NE(finding.channel.rfind("bearing", 0), 0u) << finding.channel;
  }
  // at an alarm rate of 0.5 % two of ten come by once in 900 runs
  EXPECT_LE(alarms, 1);
}

// A sensor beside the turning point makes ranges longer and shorter once per turn, as a cover that is off centre: bearings would tell.
TEST(RangesAloneDiagnosed, ACoverOffCentreOrASensorOffCentreIsNamed) {
  const Diagnosis d = diagnosed("effects: {range_eccentricity: {cosine_m: 0.02}}\n", 4);
  EXPECT_EQ(d.verdict, Verdict::explained) << d.sentence;
  ASSERT_EQ(d.final_effects.size(), 1u) << d.sentence;
  for (const char* either : {"range_eccentricity", "lever_arm"})
    EXPECT_NE(d.sentence.find(either), std::string::npos) << d.sentence;
}

}  // namespace
}  // namespace rangecal
