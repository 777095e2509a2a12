// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/world/scene.hpp"

#include <gtest/gtest.h>

#include <map>
#include <string>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;

const std::string kSensor = "sensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.01}\n";
const std::string kStops = "stops: {line: {count: 3, step_m: 0.5}}\n";
const std::string kLandmarks =
    "landmarks: {list: [{landmark: A, x_m: 1, y_m: 1}, {landmark: B, x_m: 2, y_m: 1}]}\n";
const std::string kScene = "format: rangecal-scene/1\n" + kSensor + kStops + kLandmarks;

std::string error_of(const std::string& text, SceneScope scope = SceneScope::any) {
  const TemporaryFolder folder;
  folder.write("s.yaml", text);
  try {
    load_scene(folder.file("s.yaml"), scope);
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
            "known_distances, repeats, visibility, timing, effects");
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

TEST(Scene, ErrorsOfEffectsNameTheParameter) {
  const auto error = [](const std::string& effects) {
    return error_of(kScene + "repeats: 3\neffects:\n" + effects);
  };
  const std::string field = "s.yaml, row 7: field 'effects.";
  EXPECT_EQ(error("  range_offset: {offset_m: 0.1}\n"), "no error");
  EXPECT_EQ(error("  ghost: {size_m: 1}\n"),
            field + "ghost': no effect is called 'ghost'; `rangecal effects` lists them");
  EXPECT_EQ(error("  quantisation: {step_m: 1}\n"),
            field +
                "quantisation.step_m': the effect quantisation has no parameter 'step_m'; known here: "
                "disparity_step_per_m, output_step_m");
  EXPECT_EQ(error("  quantisation:\n    output_step_m: 0.5\n"),
            "s.yaml, row 8: field 'effects.quantisation.output_step_m': 0.5 is outside 0 to 0.05");
  EXPECT_EQ(error("  tilt: {sine_rad2: steep}\n"), field + "tilt.sine_rad2': 'steep' is not a number");
  EXPECT_EQ(error("  tilt: {}\n  tilt: {}\n"), "s.yaml, row 8: field 'effects.tilt': the key stands twice");
  EXPECT_EQ(error("  tilt: 0.1\n"), field + "tilt': is not a map of keys to values");
  EXPECT_EQ(error("  dark_target: {log_variance: 1, landmark: 2}\n"),
            field + "dark_target.landmark': 2 is no landmark: 0 to 1, in the scene's order");
  EXPECT_EQ(error("  wheel_slip: {distance_m: 0.1, stop: 1.5}\n"),
            field + "wheel_slip.stop': 1.5 is no stop: 0 to 2, in the scene's order");
  EXPECT_EQ(error("  label_swap: {first: 1}\n"),
            field + "label_swap': first and second are one landmark: name two");
  // What the scene lacks, as the diagnosis says it of a recording.
  EXPECT_EQ(error("  warmup_drift: {offset_m: 0.01}\n"),
            field + "warmup_drift': the scene lacks times: a column time_s, which `timing` gives");
  EXPECT_EQ(
      error("  range_scale: {scale: 0.01, form: 1}\n"),
      field + "range_scale.form': any form but 0 takes a column temperature_c, which a scene does not have");
  EXPECT_EQ(error("  arc_definition: {kappa: 0.2}\n"),
            field + "arc_definition': the scene lacks radii: landmarks with a radius_m");
  EXPECT_EQ(error("  stop_effect: {position_sigma_m: 1}\n"),
            field + "stop_effect': the scene lacks stops: at least 4");
  const std::string pairs =
      "format: rangecal-scene/1\nkind: pairs\nsensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}}\n"
      "batches: {distances_m: [1, 2], readings: 5}\neffects:\n";
  EXPECT_EQ(error_of(pairs + "  quantisation: {output_step_m: 0.01}\n"), "no error");
  EXPECT_EQ(
      error_of(pairs + "  range_eccentricity: {sine_m: 0.01}\n"),
      "s.yaml, row 6: field 'effects.range_eccentricity': the scene lacks directions: a column bearing_rad, "
      "which the pairs of a scene do not have");
  EXPECT_EQ(
      error_of(pairs + "  lever_arm: {x_m: 0.01}\n"),
      "s.yaml, row 6: field 'effects.lever_arm': the scene lacks stops: a recording of kind landmarks, pairs "
      "have none");
}

TEST(Scene, WhatIsLeftOutOfAnEffectIsNothingOrTypical) {
  const Scene scene = parse_scene(kScene + "repeats: 3\ntiming: {}\n", "scene");
  ASSERT_TRUE(scene.timing);
  using Values = std::map<std::string, double>;
  // 0 where the effect is linear in it; a period or a time constant is none at 0.
  EXPECT_EQ(scene_effect(scene, "range_eccentricity", {{"sine_m", 0.01}}),
            (Values{{"cosine_m", 0.0}, {"sine_m", 0.01}}));
  EXPECT_EQ(scene_effect(scene, "warmup_drift", {{"offset_m", 0.01}}),
            (Values{{"offset_m", 0.01}, {"curvature_per_m", 0.0}, {"time_s", 600.0}}));
  // One grid is not two, unless none is said.
  EXPECT_EQ(scene_effect(scene, "quantisation", {{"output_step_m", 0.002}}),
            (Values{{"disparity_step_per_m", 0.0}, {"output_step_m", 0.002}}));
  EXPECT_EQ(scene_effect(scene, "quantisation", {}),
            (Values{{"disparity_step_per_m", 0.001}, {"output_step_m", 0.001}}));
  EXPECT_EQ(scene_effect(scene, "range_scale", {{"scale", 0.01}}), (Values{{"scale", 0.01}, {"form", 0.0}}));
  EXPECT_THROW(scene_effect(scene, "ghost", {}), InputError);
}

TEST(Scene, TheSensorIsPolynomialOrOptical) {
  const std::string rest = "noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.01}\n";
  const auto error = [&](const std::string& sensor, const std::string& more = "") {
    return error_of("format: rangecal-scene/1\nsensor: {" + sensor + rest + kStops + kLandmarks + more);
  };
  EXPECT_EQ(error("model: optical, "), "no error");
  EXPECT_EQ(error("model: lidar, alpha: [0, 1], "),
            "s.yaml, row 2: field 'sensor.model': 'lidar' is neither polynomial nor optical");
  EXPECT_EQ(
      error("model: optical, alpha: [0, 1], "),
      "s.yaml, row 2: field 'sensor.alpha': belongs to the polynomial model: here the optics make the curve");
  EXPECT_EQ(error("model: optical, focal_mm: 0, "),
            "s.yaml, row 2: field 'sensor.focal_mm': 0 is outside 0.001 to 10000");
  EXPECT_EQ(
      error("model: optical, tilt_rad: 0.1, "),
      "s.yaml, row 2: field 'sensor.tilt_rad': needs landmarks with a radius_m: a tilted beam misses a line");
  EXPECT_EQ(
      error("model: optical, ", "effects: {range_offset: {offset_m: 0.1}}\n"),
      "s.yaml, row 5: field 'effects': act on a polynomial sensor: what departs in an optical one are fields of "
      "its own");
}

TEST(Scene, OthersThanSimulateTakeTheSeedModelAlone) {
  const std::string why = "is for 'rangecal simulate': the seed model alone is taken here";
  EXPECT_EQ(error_of(kScene + "effects: {range_offset: {offset_m: 0.1}}\n", SceneScope::seed_model),
            "s.yaml, row 5: field 'effects': " + why);
  const std::string optical =
      "sensor: {model: optical, noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.01}\n";
  EXPECT_EQ(error_of("format: rangecal-scene/1\n" + optical + kStops + kLandmarks, SceneScope::seed_model),
            "s.yaml, row 2: field 'sensor.model': " + why);
}

TEST(Scene, TimesAreThoseOfSweepsAndDrives) {
  // Two sweeps 0.5 s apart at each stop, 10 s from the last to the next stop's first: 0, 0.5, 11, 11.5, 22, 22.5 s.
  const Recording recording =
      simulate(parse_scene(kScene + "repeats: 2\ntiming: {drive_s: 10, sweep_s: 0.5}\n", "scene"), 1);
  const Recording without = simulate(parse_scene(kScene + "repeats: 2\n", "scene"), 1);
  EXPECT_TRUE(without.readings.time_s.empty());
  EXPECT_EQ(recording.readings.range_m, without.readings.range_m);
  ASSERT_EQ(recording.readings.time_s.size(), recording.readings.size());
  for (std::size_t i = 0; i < recording.readings.size(); ++i)
    EXPECT_EQ(recording.readings.time_s[i],
              11.0 * recording.readings.stop[i] + 0.5 * recording.readings.repeat[i]);
}

TEST(Scene, WhatIsBeyondTheSeedModelReadsBackAsItWasWritten) {
  const std::string effects =
      "effects:\n  quantisation: {disparity_step_per_m: 0, output_step_m: 0.002}\n  range_offset: {offset_m: 0.1}\n";
  EXPECT_EQ(departures_text(parse_scene(kScene + effects, "scene", SceneScope::any)), effects);
  EXPECT_EQ(departures_text(parse_scene(kScene, "scene")), "");
  const Scene optical = parse_scene(
      "format: rangecal-scene/1\nsensor: {model: optical, focal_mm: 14, noise: {law: f2, sigma: 0.01}, "
      "sigma_theta_rad: 0.01}\n" +
          kStops + kLandmarks,
      "scene", SceneScope::any);
  EXPECT_EQ(departures_text(optical), "sensor: {model: optical, focal_mm: 14}\n");
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
    EXPECT_GT(simulate_scene(load_scene(folder.file("s.yaml"), SceneScope::any), 1).counts.used, 0);
    ++examples;
  }
  EXPECT_EQ(examples, 4);
}

}  // namespace
}  // namespace rangecal
