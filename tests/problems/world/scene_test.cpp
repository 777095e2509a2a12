// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/scene.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;

const std::string kSensor = "sensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.01}\n";
const std::string kStops = "stops: {line: {count: 3, step_m: 0.5}}\n";
const std::string kLandmarks =
    "landmarks: {list: [{landmark: A, x_m: 1, y_m: 1}, {landmark: B, x_m: 2, y_m: 1}]}\n";
const std::string kScene = "format: rangecal-scene/1\n" + kSensor + kStops + kLandmarks;

std::string error_of(const std::string& text) {
  const TemporaryFolder folder;
  folder.write("s.yaml", text);
  try {
    load_scene(folder.file("s.yaml"));
  } catch (const InputError& error) {
    return std::string(error.what()).substr(folder.path().size() + 1);
  }
  return "no error";
}

TEST(Scene, ErrorsNameTheField) {
  EXPECT_EQ(error_of(kScene), "no error");
  EXPECT_EQ(error_of("format: rangecal/1\n"),
            "s.yaml, row 1: field 'format': 'rangecal/1' is not rangecal-scene/1");
  EXPECT_EQ(error_of(kScene + "repeat: 3\n"),
            "s.yaml, row 5: field 'repeat': unknown key; known here: format, kind, sensor, stops, landmarks, "
            "known_distances, repeats, visibility");
  EXPECT_EQ(error_of(kScene + "repeats: 0\n"),
            "s.yaml, row 5: field 'repeats': '0' is not a whole number of at least 1");
  EXPECT_EQ(error_of("format: rangecal-scene/1\n" + kSensor + kStops),
            "s.yaml, row 1: field 'landmarks': is missing");
  EXPECT_EQ(
      error_of("format: rangecal-scene/1\n" + kSensor +
               "stops: {line: {count: 3, step_m: 0.5, direction_rad: 90}}\n" + kLandmarks),
      "s.yaml, row 3: field 'stops.line.direction_rad': is beyond +-2 pi rad: degrees, most likely; convert to "
      "radians");
  EXPECT_EQ(error_of("format: rangecal-scene/1\n" + kSensor + kStops +
                     "landmarks:\n  radius_m: 0.2\n  list:\n    - {landmark: A, x_m: 0.1, y_m: 0}\n"),
            "s.yaml, row 7: field 'landmarks.list[0]': landmark 'A' covers stop '0'");
  EXPECT_EQ(
      error_of("format: rangecal-scene/1\nsensor: {alpha: [0, 1], noise: {law: f9, sigma: 1}}\n" + kStops +
               kLandmarks),
      "s.yaml, row 2: field 'sensor.noise.law': noise law is 'f9', not one of constant, f, f2, f3, d2, polynomial");
  EXPECT_EQ(error_of(kScene + "known_distances: [{from: A, to: C, sigma_m: 0.001}]\n"),
            "s.yaml, row 5: field 'known_distances[0].to': unknown landmark 'C'");
  EXPECT_THROW(load_scene("/nowhere.yaml"), InputError);
}

TEST(Scene, ListedStopsTapesAndDefaults) {
  const TemporaryFolder folder;
  folder.write("s.yaml", "format: rangecal-scene/1\n" + kSensor +
                             "stops:\n  sigma_xy_m: 0.02\n  list:\n"
                             "    - {stop: a, x_m: 0, y_m: 0, heading_rad: 6.0, place: p}\n"
                             "    - {x_m: 1, y_m: 0, sigma_xy_m: 0.5, sigma_heading_rad: 0.1}\n" +
                             kLandmarks + "known_distances: [{from: A, to: B, sigma_m: 0.001}]\n");
  const Scene scene = load_scene(folder.file("s.yaml"));
  ASSERT_EQ(scene.stops.size(), 2u);
  EXPECT_EQ(scene.stops[0].place, "p");
  EXPECT_NEAR(scene.stops[0].commanded.heading_rad, 6.0 - 6.283185307179586, 1e-15);
  EXPECT_EQ(scene.stops[1].label, "1");
  EXPECT_EQ(scene.stops[1].sigma_xy_m, 0.5);
  EXPECT_EQ(scene.repeats, 1);
  const Recording recording = simulate(scene, 0);
  ASSERT_EQ(recording.known_distances.size(), 1u);
  EXPECT_NEAR(recording.known_distances[0].distance_m, 1.0, 6 * 0.001);  // A to B is 1 m; six deviations
}

TEST(Scene, TheExamplesInItsDocumentationLoad) {
  // Each block of docs/scene.md that begins with the format is a whole scene.
  const std::string text = read_file(std::string(RANGECAL_SOURCE_DIR) + "/docs/scene.md");
  const std::string open = "```yaml\nformat: ";
  int examples = 0;
  for (std::size_t at = text.find(open); at != std::string::npos; at = text.find(open, at + 1)) {
    const std::size_t begin = at + 8;
    const TemporaryFolder folder;
    folder.write("s.yaml", text.substr(begin, text.find("```", begin) - begin));
    EXPECT_GT(simulate(load_scene(folder.file("s.yaml")), 1).counts.used, 0);
    ++examples;
  }
  EXPECT_EQ(examples, 2);
}

}  // namespace
}  // namespace rangecal
