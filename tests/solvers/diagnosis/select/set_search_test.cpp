// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/set_search.hpp"

#include <fmt/core.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal {
namespace {

const testing::Planted three{{"encoder_ellipticity", 0.008}, {"path_curvature", 0.004}, {"settling", 0.012}};

struct Answer {
  Diagnosis diagnosis;
  std::vector<TriedSet> tried;
};

Answer answer_of(const Recording& recording) {
  Answer answer;
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.trace = [&](const TriedSet& set) { answer.tried.push_back(set); };
  answer.diagnosis = diagnose(std::span(&recording, 1), options);
  return answer;
}

std::vector<std::string> sorted(std::vector<std::string> names) {
  std::sort(names.begin(), names.end());
  return names;
}

TEST(SetSearch, NamesThreeCausesAndTracesHow) {
  const Answer answer = answer_of(testing::recording_with(three, "SetSearch.Three"));
  EXPECT_EQ(answer.diagnosis.verdict, Verdict::explained) << answer.diagnosis.sentence;
  EXPECT_EQ(sorted(answer.diagnosis.final_effects),
            (std::vector<std::string>{"encoder_ellipticity", "path_curvature", "settling"}));
  EXPECT_GT(answer.diagnosis.explanations.at(0).probability, 0.5);
  // The trace says what was tried and what it is worth.
  ASSERT_GT(answer.tried.size(), 5u);
  double total = 0.0;
  for (std::size_t i = 0; i < answer.tried.size(); ++i) {
    const TriedSet& set = answer.tried[i];
    total += set.probability;
    EXPECT_NEAR(set.log_posterior, set.gain + set.parameter_volume + set.formula_allowance + set.prior_mass,
                1e-9);
    if (i > 0) {
      EXPECT_LE(set.log_posterior, answer.tried[i - 1].log_posterior);
      EXPECT_NE(set.members, answer.tried[i - 1].members) << "no set twice";
    }
  }
  EXPECT_NEAR(total, 1.0, 1e-9);
  EXPECT_TRUE(answer.tried.front().scanned) << "the search looked around the set that it ends with";
  EXPECT_EQ(std::count_if(answer.tried.begin(), answer.tried.end(),
                          [](const TriedSet& set) { return set.members.empty(); }),
            1)
      << "the seed model";
  const auto written = nlohmann::json::parse(trace_to_json(answer.tried));
  EXPECT_EQ(written.at("format"), "rangecal-trace/1");
  EXPECT_EQ(written.at("sets").size(), answer.tried.size());
}

TEST(SetSearch, GivesTheSameBitsOnAnyNumberOfCores) {
  const Recording recording = testing::recording_with({{"encoder_ellipticity", 0.004}}, "SetSearch.Cores");
  const auto on = [&](std::size_t cores) {
    tbb::global_control limit(tbb::global_control::max_allowed_parallelism, cores);
    return trace_to_json(answer_of(recording).tried);
  };
  EXPECT_EQ(on(1), on(2));
}

TEST(SetSearch, ACauseOutsideTheCatalogueIsACurveWithoutAName) {
  const Answer answer = answer_of(testing::recording_with({{"motor_detents", 0.03}}, "SetSearch.Outside"));
  EXPECT_EQ(answer.diagnosis.verdict, Verdict::unexplained);
  EXPECT_EQ(answer.diagnosis.final_effects, std::vector<std::string>{"generic"}) << answer.diagnosis.sentence;
  EXPECT_EQ(answer.tried.front().members, std::vector<std::string>{"curve of bearing along sensor_bearing"});
}

/// True if the parameters that a set has more may be nothing. Those of a random walk of the stops may not: it takes the place of
/// independent errors at every size.
bool holds(const TriedSet& large, const TriedSet& small) {
  const auto walks = [](const TriedSet& set) {
    return std::find(set.members.begin(), set.members.end(), "odometry_random_walk") != set.members.end();
  };
  return std::includes(large.members.begin(), large.members.end(), small.members.begin(),
                       small.members.end()) &&
         walks(large) == walks(small);
}

/// The likelihood of a set is at least that of any set that it holds.
TEST(SetSearch, NoSetNearTheLikeliestGainsLessThanASetWithinIt) {
  for (const testing::Planted& planted :
       {testing::Planted{{"wheel_slip", -0.3}},
        testing::Planted{{"near_regime", 0.05}, {"path_curvature", 0.02}}}) {
    const Answer answer =
        answer_of(testing::recording_with(planted, "SetSearch.Nested" + planted.front().first));
    ASSERT_FALSE(answer.tried.empty());
    for (const TriedSet& large : answer.tried)
      for (const TriedSet& small : answer.tried) {
        if (!holds(large, small)) continue;
        const double lost = small.gain - large.gain;
        if (large.log_posterior + lost < answer.tried.front().log_posterior - 15.0) continue;
        EXPECT_LT(lost, 1.0) << ::testing::PrintToString(large.members) << " gains less than "
                             << ::testing::PrintToString(small.members);
      }
  }
}

/// 20 stops along an arc of a metre and nine tenths, five landmarks, eight readings of each.
Recording along_an_arc(const std::string& effects, std::uint64_t seed) {
  std::string stops;
  double x = 0.0, y = 0.0;
  for (int k = 0; k < 20; ++k) {
    const double heading = 0.1 * k;
    stops +=
        fmt::format("    - {{stop: s{}, x_m: {:.4f}, y_m: {:.4f}, heading_rad: {:.1f}}}\n", k, x, y, heading);
    x += 0.2 * std::cos(heading + 0.05);
    y += 0.2 * std::sin(heading + 0.05);
  }
  const std::string text =
      "format: rangecal-scene/1\n"
      "sensor: {alpha: [0.05, 0.9, 0.05], noise: {law: f2, sigma: 0.0008}, sigma_theta_rad: 0.001}\n"
      "stops:\n  list:\n" +
      stops +
      "  sigma_xy_m: 0.005\n  sigma_heading_rad: 0.005\n"
      "landmarks: {list: [{landmark: A, x_m: 1, y_m: 3.5}, {landmark: B, x_m: 3, y_m: -0.7},\n"
      "  {landmark: C, x_m: -1.2, y_m: 1.6}, {landmark: D, x_m: 3.4, y_m: 2.4}, {landmark: E, x_m: -0.6, y_m: -1.1}]}\n"
      "repeats: 8\neffects: " +
      effects + "\n";
  return simulate_scene(parse_scene(text, "arc", SceneScope::any), seed);
}

// Where the path turns evenly, a curvature and a scale of the turns are one thing. Of an effect a thousand times the noise the linearised
// problem is off by more nats than separate sets.
TEST(SetSearch, ATwinOfALargeCauseBesideAnotherOneIsFitted) {
  const Recording recording =
      along_an_arc("{path_curvature: {curvature_per_m: 0.08}, encoder_eccentricity: {sin_rad: 0.02}}",
                   seed_from("SetSearch.Arc"));
  const Answer answer = answer_of(recording);
  EXPECT_EQ(answer.diagnosis.verdict, Verdict::explained) << answer.diagnosis.sentence;
  std::vector<std::vector<std::string>> sets = answer.diagnosis.explanations.at(0).indistinguishable_from;
  sets.push_back(answer.diagnosis.final_effects);
  for (std::vector<std::string>& set : sets) set = sorted(set);
  for (const char* twin : {"path_curvature", "turn_scale"})
    EXPECT_TRUE(std::find(sets.begin(), sets.end(), std::vector<std::string>{"encoder_eccentricity", twin}) !=
                sets.end())
        << twin << ": " << answer.diagnosis.sentence;
}

TEST(SetSearch, ATailAndACauseAreFoundTogether) {
  const Answer answer = answer_of(
      testing::recording_with({{"heavy_tails", 0.05}, {"encoder_ellipticity", 0.01}}, "SetSearch.Tail"));
  EXPECT_EQ(sorted(answer.diagnosis.final_effects),
            (std::vector<std::string>{"encoder_ellipticity", "heavy_tails"}))
      << answer.diagnosis.sentence;
}

// Against a simulation a random walk of the stops shows more than a slip does where all is linearised, and beside it the slip is worth little: that
// the slip alone is likelier shows where the walk is taken out again.
TEST(SetSearch, ASlipIsNoRandomWalk) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  int right = 0;
  constexpr int worlds = 6;
  for (std::uint64_t i = 0; i < worlds; ++i) {
    Random random(seed_from("SetSearch.Slip", {i}));
    const world::World clean = world::make_line_design();
    const Recording simulation = world::simulate(clean, seed_from("SetSearch.Slip", {i, 1}));
    const Recording recording = world::simulate(world::apply(clean, "wheel_slip", 0.095, random),
                                                seed_from("SetSearch.Slip", {i, 2}));
    const Diagnosis diagnosis = diagnose_against({&recording, 1}, {&simulation, 1}, options);
    right += diagnosis.final_effects == std::vector<std::string>{"wheel_slip"};
  }
  EXPECT_EQ(right, worlds);
}

TEST(SetSearch, NothingIsSearchedWithoutAnAlarm) {
  const Answer answer = answer_of(testing::recording_with({}, "SetSearch.Clean"));
  EXPECT_EQ(answer.diagnosis.verdict, Verdict::no_mismatch) << answer.diagnosis.sentence;
  EXPECT_TRUE(answer.tried.empty());
}

}  // namespace
}  // namespace rangecal
