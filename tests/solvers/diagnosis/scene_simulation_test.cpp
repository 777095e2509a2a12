// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>
#include <ostream>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/catalogue.hpp"
#include "support/planted_scene.hpp"

namespace rangecal {
namespace {

using test::covariates_of_columns;
using testing::planted_scene;
using testing::planted_text;
using testing::seed_sensor;

Diagnosis names_of(const Recording& recording) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  return diagnose({&recording, 1}, options);
}

/// An effect at a generous size, and the name that its recording is to have.
struct Planted {
  const char *name, *text;
};
void PrintTo(const Planted& planted, std::ostream* out) { *out << planted.name; }
std::string name_of(const ::testing::TestParamInfo<Planted>& info) { return info.param.name; }

class SceneEffectsNamed : public ::testing::TestWithParam<Planted> {};

TEST_P(SceneEffectsNamed, IsDiagnosedByItsName) {
  const std::string name = GetParam().name;
  const Scene scene = planted_scene(name + ": " + GetParam().text);
  const Recording recording = simulate_scene(scene, seed_from("SceneEffects." + name, {1}));
  const Diagnosis d = names_of(recording);
  EXPECT_EQ(d.final_effects, std::vector<std::string>{name}) << d.sentence;
}

INSTANTIATE_TEST_SUITE_P(
    OfEachKind, SceneEffectsNamed,
    ::testing::Values(Planted{"range_eccentricity", "{cosine_m: 0.02}"},         // mean
                      Planted{"warmup_drift", "{offset_m: 0.05, time_s: 300}"},  // mean, along time
                      Planted{"dark_target", "{log_variance: 2, landmark: 2}"},  // spread
                      Planted{"heavy_tails", "{share: 0.05, ratio: 8}"},         // tail
                      Planted{"reciprocal_noise", "{cv_per_m: 0.05}"},           // tail, with its own noise
                      Planted{"cell_effect", "{sigma_m: 0.02}"},                 // dependence
                      Planted{"lever_arm", "{x_m: 0.05}"},                       // stops
                      Planted{"wheel_slip", "{distance_m: 0.1, stop: 10}"},      // stops, from one on
                      Planted{"label_swap", "{first: 1, second: 3, from_stop: 4, to_stop: 4}"},  // labels
                      Planted{"quantisation", "{output_step_m: 0.01}"},                          // grid
                      Planted{"bearing_quantisation", "{step_rad: 0.02}"},  // grid of bearings
                      Planted{"dropout", "{limit_m: 3.6}"}),                // detection
    name_of);

TEST(SceneSimulation, OpticsAreDiagnosedByWhatDepartsInThem) {
  // Nothing of the optics is written in the formulas that name it.
  for (const auto& [field, name] : {std::pair("tilt_rad: 0.1, tilt_axis_rad: 0.5", "tilt"),
                                    std::pair("cover_offset_m: 0.02", "range_eccentricity"),
                                    std::pair("disc_offset_mm: 0.3", "encoder_eccentricity"),
                                    std::pair("centroid_step_px: 0.1", "quantisation")}) {
    const Scene scene =
        parse_scene(planted_text("", std::string("model: optical, ") + field), "optical", SceneScope::any);
    const Diagnosis d = names_of(simulate_scene(scene, seed_from(std::string("Optics.") + name, {1})));
    EXPECT_EQ(d.final_effects, std::vector<std::string>{name}) << d.sentence;
  }
}

/// Everything that is read of a recording, for comparison.
std::vector<double> values_of(const Recording& recording) {
  const Readings& r = recording.readings;
  std::vector<double> values(r.range_m);
  values.insert(values.end(), r.bearing_rad.begin(), r.bearing_rad.end());
  values.insert(values.end(), r.landmark.begin(), r.landmark.end());
  return values;
}

TEST(SceneSimulation, WithoutEffectsItIsTheSeedModelsRecording) {
  const Scene scene = parse_scene(planted_text(""), "seed model");
  const Recording one = simulate_scene(scene, 7), two = simulate(scene, 7);
  EXPECT_EQ(values_of(one), values_of(two));
  EXPECT_EQ(one.readings.time_s, two.readings.time_s);
  EXPECT_EQ(one.truth.landmarks, two.truth.landmarks);
  EXPECT_THROW(simulate(planted_scene("range_offset: {offset_m: 0.1}"), 7), InputError);
}

TEST(SceneSimulation, EveryEffectOfTheCatalogueActs) {
  // Against an effect of no size, drawn with the same seed; axial_depth takes a sensor that looks one way.
  const std::string rest = "effects: {range_offset: {offset_m: 0}}\n";
  const std::string one_way =
      "format: rangecal-scene/1\nsensor: {" + seed_sensor +
      ", noise: {law: f2, sigma: 0.005}, sigma_theta_rad: 0.0087}\nrepeats: 4\n"
      "stops: {list: [{x_m: 0, y_m: 0}, {x_m: 0.2, y_m: 0.1}]}\n"
      "landmarks: {list: [{landmark: A, x_m: 2, y_m: 1}, {landmark: B, x_m: 2, y_m: -1}]}\n";
  int acted = 0;
  for (const auto& effect : effect_registry()) {
    const std::string& id = effect->info().id;
    if (covariates_of_columns.count(effect->info().covariate) || id == "device_offset" ||
        id == "antenna_pattern" || id == "range_saturation")
      continue;  // a scene has neither columns nor devices, and says of no distances beforehand
    const std::string text = id == "axial_depth" ? one_way : planted_text("");
    Scene plain = parse_scene(text + rest, "plain", SceneScope::any);
    Scene scene = parse_scene(text, id);
    std::map<std::string, double> sizes;
    for (const EffectParameter& p : effect->info().parameters)
      if (p.linear) sizes[p.name] = p.typical;
    if (id == "label_swap") sizes["second"] = 2.0;
    if (id == "reciprocal_noise")
      plain.noise.parameters[0] = 0.02;  // its typical size, which takes the noise's place
    scene.effects[id] = scene_effect(scene, id, sizes);
    EXPECT_NE(values_of(simulate_scene(scene, 3)), values_of(simulate_scene(plain, 3))) << id;
    ++acted;
  }
  EXPECT_GE(acted, 44);
}

TEST(SceneSimulation, RandomLandmarksAndTapesAreThoseWithoutEffects) {
  const std::string text =
      "format: rangecal-scene/1\nsensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}, sigma_theta_rad: 0.01}\n"
      "stops: {line: {count: 4, step_m: 0.5}}\nknown_distances: [{from: A, to: B, sigma_m: 0.002}]\n"
      "landmarks: {list: [{landmark: A, x_m: 1, y_m: 1}, {landmark: B, x_m: 2, y_m: 1}],\n"
      "            random: {count: 3, x_m: [0, 3], y_m: [-3, 3]}}\n";
  const Recording plain = simulate_scene(parse_scene(text, "plain"), 5);
  const Recording planted = simulate_scene(
      parse_scene(text + "effects: {range_offset: {offset_m: 0.1}}\n", "planted", SceneScope::any), 5);
  EXPECT_EQ(planted.truth.landmarks, plain.truth.landmarks);
  ASSERT_EQ(planted.known_distances.size(), 1u);
  EXPECT_EQ(planted.known_distances[0].distance_m, plain.known_distances[0].distance_m);
}

TEST(SceneSimulation, DropoutLosesWhatIsFartherAndCountsIt) {
  const Recording recording = simulate_scene(planted_scene("dropout: {limit_m: 3}"), 1);
  for (const double range : recording.readings.range_m) EXPECT_LE(range, 3.0);
  EXPECT_EQ(recording.counts.read, 1000);  // 20 stops, 5 landmarks, 10 repeats
  EXPECT_GT(recording.counts.dropped.at("lost to dropout"), 100);
  EXPECT_EQ(recording.counts.used + recording.counts.dropped.at("lost to dropout"), 1000);
  EXPECT_EQ(recording.counts.cells_left_out, 0);  // that is for limits which the sensor states
}

TEST(SceneSimulation, LabelsAreExchangedWhereTheSceneSays) {
  const Recording plain = simulate_scene(planted_scene("range_offset: {offset_m: 0}"), 1);
  const Recording swapped =
      simulate_scene(planted_scene("label_swap: {first: 0, second: 4, from_stop: 3, to_stop: 5}"), 1);
  ASSERT_EQ(swapped.readings.range_m, plain.readings.range_m);
  for (std::size_t i = 0; i < plain.readings.size(); ++i) {
    const int stop = plain.readings.stop[i], landmark = plain.readings.landmark[i];
    const bool other = stop >= 3 && stop <= 5 && (landmark == 0 || landmark == 4);
    EXPECT_EQ(swapped.readings.landmark[i], other ? 4 - landmark : landmark);
  }
}

TEST(SceneSimulation, GridsLimitsAndVisibilityHold) {
  Scene scene = planted_scene("quantisation: {output_step_m: 0.002}");
  scene.sensor.range_max_m = 3.0;
  scene.visible_min_m = 0.8;
  const Recording recording = simulate_scene(scene, 1);
  int dropped = 0;
  for (const auto& reason : recording.counts.dropped) dropped += reason.second;
  EXPECT_EQ(recording.counts.used + dropped, recording.counts.read);
  EXPECT_LT(recording.counts.read, 1000);
  EXPECT_GT(recording.counts.cells_left_out, 0);
  for (std::size_t i = 0; i < recording.readings.size(); ++i) {
    const double range = recording.readings.range_m[i];
    EXPECT_LT(std::abs(std::remainder(range, 0.002)), 1e-12);
    EXPECT_LE(range, 3.0);
    const Pose2& stop = *recording.truth.stops[static_cast<std::size_t>(recording.readings.stop[i])];
    const auto l = static_cast<std::size_t>(recording.readings.landmark[i]);
    const double d = (*recording.truth.landmarks[l] - Eigen::Vector2d(stop.x_m, stop.y_m)).norm() -
                     recording.landmarks[l].radius_m;
    EXPECT_GE(d, 0.8);
  }
}

/// Pairs at 1 and at 4 m, 2000 readings each, of a sensor that reads the distance; sigma f^2 with sigma = 0.01.
std::pair<double, double> spreads_with(const std::string& effects, bool of_inverse = false) {
  const Scene scene = parse_scene(
      "format: rangecal-scene/1\nkind: pairs\nsensor: {alpha: [0, 1], noise: {law: f2, sigma: 0.01}}\n"
      "batches: {distances_m: [1, 4], readings: 2000}\neffects: {" +
          effects + "}\n",
      "pairs", SceneScope::any);
  const Recording recording = simulate_scene(scene, seed_from("SceneSimulation " + effects));
  EXPECT_EQ(recording.pairs.size(), 4000u);
  EXPECT_EQ(recording.pairs.batch_labels, (std::vector<std::string>{"0", "1"}));
  const auto spread = [&](double d) {
    double sum = 0.0;
    for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
      if (recording.pairs.true_m[i] != d) continue;
      const double y = recording.pairs.reading_m[i], off = of_inverse ? 1.0 / y - 1.0 / d : y - d;
      sum += off * off;
    }
    return std::sqrt(sum / 2000.0);
  };
  return {spread(1.0), spread(4.0)};
}

TEST(SceneSimulation, TheNoiseLawAddsVarianceAtTheEndsOfTheRanges) {
  // ln 4 = 1.3863: s = 0.01 f^2 sqrt(1 + 3 (f / 4)^2): 0.010897 at 1 m, 0.32 at 4 m. The spread of 2000 readings is known to
  // 1 / sqrt(4000) = 1.6 %; five deviations.
  const auto [near, far] = spreads_with("noise_law: {log_variance_far: 1.386294361, power: 2}");
  EXPECT_NEAR(near / 0.010897, 1.0, 0.08);
  EXPECT_NEAR(far / 0.32, 1.0, 0.08);
}

TEST(SceneSimulation, ReciprocalNoiseTakesThePlaceOfTheSensors) {
  // s = cv f^2 before the reciprocal: 1 / y has the spread cv = 0.03 / m at any distance; five deviations of 1.6 %.
  const auto [near, far] = spreads_with("reciprocal_noise: {cv_per_m: 0.03}", true);
  EXPECT_NEAR(near / 0.03, 1.0, 0.08);
  EXPECT_NEAR(far / 0.03, 1.0, 0.08);
}

TEST(SceneSimulation, MoreReadingsThanMemoryHoldsAreRefused) {
  Scene scene = planted_scene("range_offset: {offset_m: 0.1}");
  scene.repeats = 200000;  // times 20 stops and 5 landmarks
  EXPECT_THROW(simulate_scene(scene, 1), InputError);
}

}  // namespace
}  // namespace rangecal
