// SPDX-License-Identifier: BSD-3-Clause
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <cmath>
#include <limits>
#include <nlohmann/json.hpp>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::test {
namespace {

using ::testing::HasSubstr;
using Json = nlohmann::json;

/// A line design whose cover is 7.5 mm off the spin axis.
Recording eccentric(std::uint64_t run) {
  Random random(seed_from("json test", {1}));
  world::World w = world::vary(world::make_line_design(), random);
  w = world::apply(w, "range_eccentricity", 0.0075, random);
  return world::simulate(w, seed_from("json test run", {run}));
}

Recording clean(std::uint64_t run) {
  Random random(seed_from("json test", {2}));
  return world::simulate(world::vary(world::make_line_design(), random),
                         seed_from("json test clean run", {run}));
}

DiagnoseOptions quick() {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  return options;
}

Diagnosis of(const Recording& recording, const DiagnoseOptions& options = quick()) {
  return diagnose({&recording, 1}, options);
}

TEST(DiagnosisJson, HoldsTheFieldsOfTheSchema) {
  const Diagnosis d = of(eccentric(1), DiagnoseOptions{});
  const Json json = Json::parse(diagnosis_to_json(d));
  EXPECT_EQ(json.at("format"), "rangecal-diagnosis/1");
  EXPECT_EQ(json.at("verdict"), "explained");
  for (const char* field : {"order", "nll", "heldout_nll", "parameters"})
    EXPECT_TRUE(json.at("baseline").contains(field)) << field;
  ASSERT_FALSE(json.at("location").empty());
  for (const char* field :
       {"channel", "covariate", "shape", "where", "size", "p_value", "share", "residuals"})
    EXPECT_TRUE(json.at("location")[0].contains(field)) << field;
  ASSERT_FALSE(json.at("explanations").empty());
  const Json& best = json.at("explanations")[0];
  for (const char* field : {"effects", "probability", "parameters", "nll", "heldout_nll", "p_value",
                            "indistinguishable_from", "separated_by", "physics"})
    EXPECT_TRUE(best.contains(field)) << field;
  EXPECT_EQ(best.at("effects"), Json({"range_eccentricity"}));
  const Json& amplitude = best.at("parameters").at("range_eccentricity.amplitude_m");
  EXPECT_NEAR(amplitude.at("estimate").get<double>(), 0.0075, 5.0 * amplitude.at("std").get<double>());
  EXPECT_LT(amplitude.at("ci95")[0].get<double>(), amplitude.at("ci95")[1].get<double>());
  EXPECT_EQ(json.at("final").at("effects"), best.at("effects"));
  EXPECT_EQ(json.at("final").at("nll"), best.at("nll"));
  EXPECT_EQ(json.at("final").at("rest"), Json::array()) << "explained: nothing is left";
  const Json& members = json.at("final").at("members");
  ASSERT_EQ(members.size(), 1u);
  EXPECT_EQ(members[0].at("effect"), "range_eccentricity");
  EXPECT_GE(members[0].at("probability").get<double>(), best.at("probability").get<double>())
      << "of all sets that hold it";
  EXPECT_LT(members[0].at("log_evidence_without").get<double>(), -10.0);
  EXPECT_NEAR(members[0].at("heldout_nll_without").get<double>(),
              json.at("baseline").at("heldout_nll").get<double>(), 1e-6)
      << "without its only name it is the seed model";
  EXPECT_LT(json.at("final").at("evidence_omitted").get<double>(), 0.1);
  EXPECT_TRUE(json.at("final").at("parameters").contains("alpha_0"));
  ASSERT_FALSE(json.at("unseen").empty());
  for (const char* field : {"effect", "typical", "detectable", "harm_m", "settled_by"})
    EXPECT_TRUE(json.at("unseen")[0].contains(field)) << field;
  ASSERT_FALSE(json.at("next_experiments").empty());
  for (const char* field : {"change", "settles", "power"})
    EXPECT_TRUE(json.at("next_experiments")[0].contains(field)) << field;
}

TEST(DiagnosisJson, WhatHasNoNameIsTheRest) {
  Diagnosis d;
  d.verdict = Verdict::partly_explained;
  d.final_effects = {"tilt", "generic"};
  d.members = {{"tilt", 0.9, -20.0, std::nullopt}};
  d.location.resize(2);
  d.location[0].effects = {"tilt"};
  Finding& left = d.location[1];
  left.channel = "range", left.covariate = "time", left.effects = {"generic"};
  left.size = 0.004, left.unit = "m", left.share = 0.25;
  const Json json = Json::parse(diagnosis_to_json(d));
  EXPECT_EQ(json.at("verdict"), "partly_explained");
  EXPECT_EQ(json.at("final").at("rest"),
            Json::parse(R"([{"channel":"range","covariate":"time","size":0.004,"unit":"m","share":0.25}])"));
  EXPECT_EQ(json.at("final").at("members"), Json::parse(R"([{"effect":"tilt","column":null,"probability":0.9,
      "log_evidence_without":-20.0,"heldout_nll_without":null}])"));
  EXPECT_TRUE(json.at("final").at("evidence_omitted").is_null());
  EXPECT_THAT(verdict_sentence(d), HasSubstr("In part explained by tilt"));
  EXPECT_THAT(verdict_sentence(d), HasSubstr(" that nothing in the catalogue accounts for."));
  d.nearly_as_likely = {"settling", "tilt", "warmup_drift"};
  EXPECT_THAT(
      verdict_sentence(d),
      HasSubstr(", for which settling and warmup_drift are nearly as likely as a curve without a name."));
  EXPECT_EQ(Json::parse(diagnosis_to_json(d)).at("final").at("nearly_as_likely").size(), 3u);
}

TEST(Probabilities, OfAllThatWasFittedAddUpToOneAtMost) {
  // A random walk that stops left out raise over the slip that gains as much.
  Random random(seed_from("probabilities", {1}));
  world::World w = world::vary(world::make_turning_design(), random);
  w = world::apply(w, "odometry_random_walk", 0.021, random);
  for (std::uint64_t run = 1; run <= 4; ++run) {
    const Diagnosis d = of(world::simulate(w, seed_from("probabilities run", {run})));
    double sum = 0.0;
    for (const Explanation& e : d.explanations) {
      EXPECT_GE(e.probability, 0.0) << run;
      sum += e.probability;
    }
    EXPECT_LE(sum, 1.0 + 1e-9) << run;
  }
}

TEST(DiagnosisJson, AnEstimateAtItsBoundHasNoStandardDeviation) {
  // y = d + 0.3 cos(1.5 d) [m]: the wavenumber of a cyclic error ends at 2 / m, below which none is searched.
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from("at its bound"));
  for (int i = 0; i < 60; ++i) {
    const double d = random.uniform(0.5, 4.0);
    for (int r = 0; r < 3; ++r) {
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(random.normal(d + 0.3 * std::cos(1.5 * d), 0.002));
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
    }
  }
  DiagnoseOptions options = quick();
  options.force = {"cyclic_error"};
  const Json json = Json::parse(diagnosis_to_json(of(recording, options)));
  const Json& parameters = json.at("explanations").at(0).at("parameters");
  EXPECT_EQ(parameters.at("cyclic_error.wavelength_m").at("note"), "at its bound");
  EXPECT_TRUE(parameters.at("cyclic_error.wavelength_m").at("std").is_null());
  EXPECT_EQ(json.at("final").at("parameters").at("cyclic_error.wavelength_m").at("note"), "at its bound");
  // The amplitude does not depend on the wavenumber, and ended at no bound of its own.
  EXPECT_EQ(parameters.at("cyclic_error.amplitude_m").at("note"), "");
  EXPECT_TRUE(parameters.at("cyclic_error.amplitude_m").at("std").is_number());
}

TEST(VerdictSentence, SaysLightTailsPlacesAndStopsAsTheyAre) {
  Diagnosis d;
  d.verdict = Verdict::unexplained;
  d.final_effects = {"generic"};
  d.location.resize(1);
  Finding& f = d.location[0];
  f.channel = "range_tail", f.covariate = "any", f.shape = "light tails", f.size = -0.61;
  EXPECT_THAT(verdict_sentence(d),
              HasSubstr("ranges with lighter tails than a normal law's (excess kurtosis -0.61)"));
  f.shape = "heavy tails", f.size = 2.5;
  EXPECT_THAT(verdict_sentence(d), HasSubstr("outliers among the ranges (excess kurtosis 2.5)"));
  // -1.047198 and 0.523599 rad are -60 and 30 degrees.
  f.channel = "range", f.covariate = "sensor_bearing", f.unit = "m", f.size = 0.004;
  f.from = -1.047198, f.to = 0.523599;
  EXPECT_THAT(verdict_sentence(d),
              HasSubstr("4 mm RMS in range along sensor_bearing between -60 and 30 degrees"));
  f.covariate = "range", f.from = 1.5, f.to.reset();
  EXPECT_THAT(verdict_sentence(d), HasSubstr("along range from 1.5 m on"));
  f.channel = "stop", f.covariate = "stop", f.from.reset();
  EXPECT_THAT(verdict_sentence(d), HasSubstr("4 mm RMS in range by stops off their place along stop"));
}

TEST(VerdictSentence, SaysWhatRivalsHaveInPlaceOfWhat) {
  Diagnosis d;
  d.verdict = Verdict::explained;
  d.final_effects = {"quantisation", "heading_drift", "tilt"};
  d.explanations.resize(1);
  auto& rivals = d.explanations[0].indistinguishable_from;
  rivals = {{"bearing_drift", "quantisation", "tilt"},
            {"path_curvature", "quantisation", "tilt"},
            {"heading_drift", "quantisation"}};
  EXPECT_EQ(
      verdict_sentence(d),
      "Explained by heading_drift, tilt and quantisation (or bearing_drift or path_curvature in place of heading_drift, or "
      "nothing in place of tilt: this recording cannot tell).");
  rivals = {{"lever_arm", "settling"}};  // nothing in common
  EXPECT_THAT(verdict_sentence(d), HasSubstr(" (or lever_arm and settling: this recording cannot tell)"));
  d.final_effects = {"heading_drift"};
  rivals = {{"bearing_drift"}, {"path_curvature"}};
  EXPECT_THAT(verdict_sentence(d),
              HasSubstr(" (or bearing_drift or path_curvature: this recording cannot tell)"));
}

TEST(DiagnosisJson, NothingThatIsNotANumberIsWritten) {
  Diagnosis d;
  d.baseline.alpha = d.corrected.alpha = Eigen::Vector2d(0.0, 1.0);
  d.before.nll = std::numeric_limits<double>::quiet_NaN();
  d.after.nll = std::numeric_limits<double>::infinity();
  d.location.resize(1);
  d.location[0].size = std::numeric_limits<double>::quiet_NaN();
  const std::string text = diagnosis_to_json(d);
  const Json json = Json::parse(text);
  EXPECT_TRUE(json.at("baseline").at("nll").is_null());
  EXPECT_TRUE(json.at("baseline").at("heldout_nll").is_null());
  EXPECT_TRUE(json.at("final").at("nll").is_null());
  EXPECT_TRUE(json.at("location")[0].at("size").is_null());
  EXPECT_TRUE(json.at("location")[0].at("where").is_null());
  EXPECT_EQ(json.at("final").at("effects"), Json::array());
}

TEST(ResidualBins, ShrinkWhenTheEffectIsModelled) {
  const Diagnosis d = of(eccentric(1));
  ASSERT_FALSE(d.location.empty());
  ASSERT_FALSE(d.location[0].residuals.empty());
  double before = 0.0, after = 0.0;
  int readings = 0;
  for (const BinnedResidual& b : d.location[0].residuals) {
    before += b.before * b.before / (b.std_dev * b.std_dev);
    after += b.after * b.after / (b.std_dev * b.std_dev);
    readings += b.readings;
  }
  EXPECT_EQ(readings, 1500);
  EXPECT_LT(after, before);
  EXPECT_THAT(d.sentence, HasSubstr("range_eccentricity"));
}

TEST(SimulationLoop, JsonRoundTripGivesTheSameRecording) {
  const Diagnosis d = of(eccentric(1));
  const SimulationModel back = simulation_model_from_json(diagnosis_to_json(d), "d.json");
  const std::vector<Recording> a = simulate(d.simulation, 5), b = simulate(back, 5), c = simulate(back, 6);
  ASSERT_EQ(a.size(), 1u);
  EXPECT_EQ(a[0].readings.range_m, b[0].readings.range_m);
  EXPECT_EQ(a[0].readings.bearing_rad, b[0].readings.bearing_rad);
  EXPECT_EQ(a[0].readings.time_s, eccentric(1).readings.time_s);
  EXPECT_NE(a[0].readings.range_m, c[0].readings.range_m);
  EXPECT_THROW(simulation_model_from_json("{}", "d.json"), InputError);
  EXPECT_THROW(simulation_model_from_json("not json", "d.json"), InputError);
}

TEST(SimulationLoop, TheCovarianceOfAStopIsReadBackOrRefused) {
  SimulationModel model = of(eccentric(1)).simulation;
  Stop& stop = model.recordings[0].stops[0];
  stop.covariance = (Eigen::Matrix3d() << 4e-4, 1e-4, 0, 1e-4, 2e-4, 1e-5, 0, 1e-5, 1e-4).finished();
  const auto read = [&] { return simulation_model_from_json(simulation_model_to_json(model), "d.json"); };
  EXPECT_EQ(read().recordings[0].stops[0].covariance, stop.covariance);
  (*stop.covariance)(0, 0) = -4e-4;
  EXPECT_THAT([&] { read(); }, ::testing::ThrowsMessage<InputError>(
                                   HasSubstr("cov_xx_m2 of stop '" + stop.label + "' is not positive")));
}

TEST(SimulationLoop, TheRecordingDoesNotDepartFromItsOwnSimulation) {
  const Recording recording = eccentric(1);
  const std::vector<Recording> simulation = simulate(of(recording).simulation, 5);
  const Diagnosis against = diagnose_against({&recording, 1}, simulation, quick());
  EXPECT_EQ(against.verdict, Verdict::no_mismatch) << against.sentence;
}

TEST(SimulationLoop, NorFromACalibrationThatCarriesTheEffect) {
  const Recording recording = eccentric(1);
  DiagnoseOptions options = quick();
  options.simulation = of(recording).corrected;
  ASSERT_EQ(options.simulation->effects.count("range_eccentricity"), 1u);
  const Diagnosis against = of(recording, options);
  EXPECT_EQ(against.verdict, Verdict::no_mismatch) << against.sentence;
  options.simulation->landmarks.pop_back();  // nowhere to read from
  EXPECT_THROW(of(recording, options), InputError);
}

TEST(Forced, WhatCannotBeFittedIsAnErrorOfOneLine) {
  DiagnoseOptions options = quick();
  options.force = std::vector<std::string>{};
  EXPECT_THROW(of(clean(1), options), InputError);
  options.force = {{"no_such_effect"}};
  EXPECT_THROW(of(clean(1), options), InputError);
}

TEST(LeftOut, AnEffectIsNotNamedNorUnseen) {
  DiagnoseOptions options = quick();
  ASSERT_EQ(of(eccentric(1), options).final_effects, std::vector<std::string>{"range_eccentricity"});
  options.without = {"range_eccentricity"};
  options.unseen = true;
  const Diagnosis d = of(eccentric(1), options);
  EXPECT_NE(d.verdict, Verdict::no_mismatch);
  EXPECT_THAT(d.final_effects, ::testing::Not(::testing::Contains("range_eccentricity")));
  for (const Unseen& u : d.unseen) EXPECT_NE(u.effect, "range_eccentricity");
  EXPECT_THAT(d.notes, ::testing::Contains("Left out of the catalogue, as asked: range_eccentricity."));
}

TEST(LeftOut, WhatCannotBeIsAnErrorOfOneLine) {
  DiagnoseOptions options;
  for (const char* id : {"no_such_effect", "label_swap", "quantisation", "dropout"}) {
    options.without = {id};
    EXPECT_THROW(options.check(), InputError) << id;
  }
  options.without = {"range_eccentricity"};
  EXPECT_NO_THROW(options.check());
  options.force = {{"bearing_offset"}};  // nothing is searched
  EXPECT_THROW(options.check(), InputError);
}

TEST(AgainstSimulation, NamesWhatTheSimulationLacks) {
  const Recording recording = eccentric(1), with = eccentric(2);
  Random random(seed_from("json test", {1}));
  const Recording without =
      world::simulate(world::vary(world::make_line_design(), random), seed_from("without", {1}));
  EXPECT_EQ(diagnose_against({&recording, 1}, {&without, 1}, quick()).final_effects,
            std::vector<std::string>{"range_eccentricity"});
  const Diagnosis alike = diagnose_against({&recording, 1}, {&with, 1}, quick());
  EXPECT_EQ(alike.verdict, Verdict::no_mismatch) << diagnosis_to_json(alike);
}

TEST(AgainstSimulation, AnotherRangeZeroIsNamed) {
  const Recording recording = clean(1);
  DiagnoseOptions options = quick();
  options.simulation = of(clean(2)).baseline;
  ASSERT_TRUE(options.simulation->alpha_covariance);
  EXPECT_EQ(of(recording, options).verdict, Verdict::no_mismatch);
  options.simulation->alpha[0] += 0.02;
  EXPECT_EQ(of(recording, options).final_effects, std::vector<std::string>{"range_offset"});
}

TEST(AgainstSimulation, ALandmarkThatTheSimulationLacksIsAnError) {
  const Recording recording = clean(1);
  Recording other = clean(2);
  for (Landmark& landmark : other.landmarks) landmark.label += "x";
  EXPECT_THROW(diagnose_against({&recording, 1}, {&other, 1}, quick()), InputError);
}

}  // namespace
}  // namespace rangecal::test
