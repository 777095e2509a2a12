// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/set_search.hpp"

#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <algorithm>
#include <nlohmann/json.hpp>

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

/// The parameters that a set has more may be nothing: its likelihood is at least that of any set within it.
TEST(SetSearch, NoSetNearTheLikeliestGainsLessThanASetWithinIt) {
  for (const testing::Planted& planted :
       {testing::Planted{{"wheel_slip", -0.3}},
        testing::Planted{{"near_regime", 0.05}, {"path_curvature", 0.02}}}) {
    const Answer answer =
        answer_of(testing::recording_with(planted, "SetSearch.Nested" + planted.front().first));
    ASSERT_FALSE(answer.tried.empty());
    for (const TriedSet& large : answer.tried)
      for (const TriedSet& small : answer.tried) {
        if (!std::includes(large.members.begin(), large.members.end(), small.members.begin(),
                           small.members.end()))
          continue;
        const double lost = small.gain - large.gain;
        if (large.log_posterior + lost < answer.tried.front().log_posterior - 15.0) continue;
        EXPECT_LT(lost, 1.0) << ::testing::PrintToString(large.members) << " gains less than "
                             << ::testing::PrintToString(small.members);
      }
  }
}

TEST(SetSearch, ATailAndACauseAreFoundTogether) {
  const Answer answer = answer_of(
      testing::recording_with({{"heavy_tails", 0.05}, {"encoder_ellipticity", 0.01}}, "SetSearch.Tail"));
  EXPECT_EQ(sorted(answer.diagnosis.final_effects),
            (std::vector<std::string>{"encoder_ellipticity", "heavy_tails"}))
      << answer.diagnosis.sentence;
}

TEST(SetSearch, NothingIsSearchedWithoutAnAlarm) {
  const Answer answer = answer_of(testing::recording_with({}, "SetSearch.Clean"));
  EXPECT_EQ(answer.diagnosis.verdict, Verdict::no_mismatch) << answer.diagnosis.sentence;
  EXPECT_TRUE(answer.tried.empty());
}

}  // namespace
}  // namespace rangecal
