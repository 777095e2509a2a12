// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/decide.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <utility>

#include "diagnosis/generic_effect.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

/// Verdicts on tables whose probabilities are given, over the readings of a recording: of one without any cause, where nothing
/// else is said.
class Decide : public ::testing::Test {
 protected:
  static testing::SeedFit& clean() {
    static testing::SeedFit fit(testing::recording_with({}, "Decide.Clean"));
    return fit;
  }
  /// Two causes that are there, for a name has to be worth something without the curve beside it.
  static testing::SeedFit& with_causes() {
    static testing::SeedFit fit(
        testing::recording_with({{"settling", 0.04}, {"beam_offset", 0.02}}, "Decide.Causes"));
    return fit;
  }
  testing::SeedFit& seed() const { return *readings_; }
  void look_at(testing::SeedFit& readings) { readings_ = &readings; }

  ActiveEffect name(const char* id) const {
    const Effect* effect = find_effect(id);
    return {effect, effect->start_grid(seed().rows.context).front()};
  }

  /// A generic curve of two knots.
  ActiveEffect curve(CurveChannel channel, const char* channel_name, const char* along) {
    curves_.push_back(std::make_shared<GenericEffect>(
        channel, channel_name, along, covariate_of(seed().rows, along), CurveBasis{{0.0, 6.0}, false, 0.0},
        Eigen::MatrixXd::Identity(2, 2).rightCols(1), 0.01));
    return {curves_.back().get(), Eigen::VectorXd::Zero(1)};
  }

  /// One set of the table.
  void add(const Model& model, double log_posterior, double formula_allowance = 0.0) {
    auto h = std::make_unique<Hypothesis>();
    h->fit = seed().fit;
    if (!model.empty()) h->fit = refit(seed().rows, model, seed().fit.state, seed().options);
    ASSERT_TRUE(h->fit.ok);
    h->log_posterior = log_posterior;
    h->formula_allowance = formula_allowance;
    table_.push_back(std::move(h));
  }

  SearchResult decided() {
    SearchResult result;
    result.baseline = seed().fit;
    decide(seed().rows, seed().fit, std::exchange(table_, {}), {}, seed().options, SelectionPriors{}, result);
    return result;
  }

  static std::vector<std::string> names_of(const SearchResult& result) {
    return ids_of(result.best.fit.model);
  }

  Hypotheses table_;
  std::vector<std::shared_ptr<GenericEffect>> curves_;

 private:
  testing::SeedFit* readings_ = &clean();
};

TEST_F(Decide, ANameOfHighProbabilityExplains) {
  add({name("settling")}, 20.0);
  add({name("lever_arm")}, 10.0);
  add({}, 0.0);
  const SearchResult result = decided();
  EXPECT_EQ(result.verdict, Verdict::explained);
  EXPECT_EQ(names_of(result), std::vector<std::string>{"settling"});
  ASSERT_EQ(result.members.size(), 1u);
  EXPECT_GT(result.members[0].probability, 0.999);
  EXPECT_NEAR(*result.members[0].log_evidence_without, -20.0, 1e-12);
  EXPECT_EQ(*result.evidence_omitted, 0.0);
}

TEST_F(Decide, TwinsPoolTheirProbability) {
  // None has half of the probability alone.
  add({name("bearing_drift")}, 20.0);
  add({name("heading_drift")}, 19.9);
  add({name("settling"), name("lever_arm")}, 19.5);
  add({}, 0.0);
  const SearchResult result = decided();
  EXPECT_EQ(result.verdict, Verdict::explained);
  EXPECT_EQ(names_of(result), std::vector<std::string>{"bearing_drift"});
}

TEST_F(Decide, ANameOfLessThanHalfTheProbabilityIsNotGiven) {
  // The curves do what the name does: e^20 against twice e^19.9.
  add({name("settling")}, 20.0);
  add({curve(CurveChannel::range, "range", "range"), curve(CurveChannel::range, "range", "time")}, 19.9);
  add({curve(CurveChannel::range, "range", "range"), curve(CurveChannel::bearing, "bearing", "time")}, 19.9);
  add({}, 0.0);
  EXPECT_EQ(decided().verdict, Verdict::unexplained);
}

TEST_F(Decide, WhatIsWorthLittleBesideACurveHasNoName) {
  const ActiveEffect along_range = curve(CurveChannel::range, "range", "range");
  add({name("settling"), along_range}, 100.0);
  add({along_range}, 98.0);  // settling is worth 2 nats
  add({name("settling")}, 10.0);
  add({}, 0.0);
  EXPECT_EQ(decided().verdict, Verdict::unexplained);
}

TEST_F(Decide, ANameStaysBesideACurveOfItsOwnOrAnotherPlaceIfItIsWorthThreeNats) {
  look_at(with_causes());
  for (const ActiveEffect& beside :
       {curve(CurveChannel::range, "range", "range"), curve(CurveChannel::bearing, "bearing", "repeat")}) {
    for (const double worth : {2.0, 4.0}) {
      add({name("settling"), beside}, 100.0);
      add({beside}, 100.0 - worth);
      add({name("settling")}, 0.0);  // the curve is worth 100 nats
      const SearchResult result = decided();
      if (worth < 3.0)
        EXPECT_EQ(result.verdict, Verdict::unexplained);
      else
        EXPECT_EQ(names_of(result), std::vector<std::string>{"settling"});
    }
  }
}

TEST_F(Decide, ANameThatACurveMayReplaceIsNotGiven) {
  look_at(with_causes());
  const ActiveEffect along_repeat = curve(CurveChannel::range, "range", "repeat");
  for (const double margin : {1.0, 2.0}) {
    add({name("beam_offset"), name("settling")}, 100.0);
    add({name("beam_offset"), along_repeat}, 100.0 - margin);
    add({name("beam_offset")}, 50.0);
    add({name("settling")}, 50.0);
    const std::vector<std::string> names = names_of(decided());
    EXPECT_EQ(names.size(), margin < 1.5 ? 1u : 2u);
    EXPECT_EQ(std::count(names.begin(), names.end(), "beam_offset"), 1);
  }
}

TEST_F(Decide, ANameWhoseShapeIsAnotherIsNotGiven) {
  // Its formula as it stands is likelier than a curve of its own place by 5 nats less the allowance: below -5 of its 100 it is another.
  for (const double allowance : {8.0, 12.0}) {
    add({name("bearing_drift")}, 100.0, allowance);
    add({curve(CurveChannel::bearing, "bearing", "time")}, 95.0);
    add({}, 0.0);
    EXPECT_EQ(decided().verdict, allowance < 9.0 ? Verdict::explained : Verdict::unexplained);
  }
}

TEST_F(Decide, NamesThatFitAsWellBesideTheSameCurveAreRivals) {
  look_at(with_causes());
  const ActiveEffect along_time = curve(CurveChannel::range, "range", "time"),
                     along_stop = curve(CurveChannel::range, "range", "stop");
  add({name("settling"), along_time}, 100.0);
  add({name("beam_offset"), along_time}, 99.8);
  add({name("lever_arm"), along_stop}, 99.7);  // beside another curve: another answer
  add({along_time}, 50.0);
  const SearchResult result = decided();
  EXPECT_EQ(names_of(result), std::vector<std::string>{"settling"});
  ASSERT_EQ(result.rivals.size(), 1u);
  EXPECT_EQ(ids_of(result.rivals[0].fit.model), std::vector<std::string>{"beam_offset"});
}

TEST_F(Decide, ANameHasTheProbabilityOfWhatIsListedAndNoMore) {
  // One nat less likely, and these readings could tell the two apart: it is not listed, and its share is against the name.
  look_at(with_causes());
  add({name("settling")}, 100.0);
  add({name("beam_offset")}, 99.0);
  add({}, 50.0);
  const SearchResult result = decided();
  EXPECT_EQ(names_of(result), std::vector<std::string>{"settling"});
  EXPECT_TRUE(result.rivals.empty());
  ASSERT_EQ(result.members.size(), 1u);
  EXPECT_NEAR(result.members[0].probability, 1.0 / (1.0 + std::exp(-1.0)), 1e-9);
}

TEST_F(Decide, ANameThatIsWorthNothingWithoutTheCurveBesideItIsNotGiven) {
  // The table has 30 nats for it beside the curve; alone it gains nothing of these readings.
  const ActiveEffect along_range = curve(CurveChannel::range, "range", "range");
  add({name("settling"), along_range}, 100.0);
  add({along_range}, 70.0);
  add({name("settling")}, 0.0);
  EXPECT_EQ(decided().verdict, Verdict::unexplained);
}

/// A recording with a jump at a distance.
class DecideOfJump : public Decide {
 protected:
  static testing::SeedFit& readings() {
    static testing::SeedFit fit(testing::recording_with({{"near_regime", 0.03}}, "Decide.Jump"));
    return fit;
  }
  DecideOfJump() { look_at(readings()); }

  /// From the start of its grid that fits best.
  static const ActiveEffect& jump() {
    static const ActiveEffect best = [] {
      const testing::SeedFit& seed = readings();
      ActiveEffect at{find_effect("near_regime"), {}};
      double least = seed.fit.nll - 10.0;
      for (const Eigen::VectorXd& start : at.effect->start_grid(seed.rows.context))
        if (const Fit fit = refit(seed.rows, {{at.effect, start}}, seed.fit.state, seed.options);
            fit.nll < least)
          least = fit.nll, at.parameters = start;
      return at;
    }();
    return best;
  }
};

TEST_F(DecideOfJump, ANameThatJumpsIsWorthTenTimesACurveBesideIt) {
  const ActiveEffect along_range = curve(CurveChannel::range, "range", "range");
  ASSERT_GT(jump().parameters.size(), 0);
  for (const double worth : {40.0, 60.0}) {
    add({jump(), along_range}, 200.0);
    add({along_range}, 200.0 - worth);
    add({jump()}, 195.0);  // the curve is worth 5 nats
    const SearchResult result = decided();
    if (worth < 50.0)
      EXPECT_EQ(result.verdict, Verdict::unexplained);
    else
      EXPECT_EQ(names_of(result), std::vector<std::string>{"near_regime"});
  }
}

TEST_F(DecideOfJump, ASmoothCurveInItsPlaceIsFarLessLikely) {
  ASSERT_GT(jump().parameters.size(), 0);
  for (const bool smooth : {true, false})
    for (const double margin : {6.0, 9.0}) {
      const ActiveEffect in_place = curve(CurveChannel::range, "range", "range");
      curves_.back()->smooth = smooth;
      add({jump()}, 100.0);
      add({in_place}, 100.0 - margin);  // of the 100 that the jump is worth
      add({}, 0.0);
      const SearchResult result = decided();
      if (smooth && margin < 7.5)
        EXPECT_EQ(result.verdict, Verdict::unexplained);
      else
        EXPECT_EQ(names_of(result), std::vector<std::string>{"near_regime"});
    }
}

TEST_F(DecideOfJump, WithoutWhichNothingFitsIsNamedWhateverACurveDoes) {
  ASSERT_GT(jump().parameters.size(), 0);
  add({jump()}, 100.0);
  add({curve(CurveChannel::range, "range", "range")}, 94.0);
  EXPECT_EQ(names_of(decided()), std::vector<std::string>{"near_regime"});
}

TEST_F(Decide, ANameBesideAStrongOneIsWorthAHundredthOfItOrNotGiven) {
  look_at(with_causes());
  for (const double worth : {4.0, 12.0}) {
    add({name("beam_offset"), name("settling")}, 800.0);
    add({name("beam_offset")}, 800.0 - worth);
    add({name("settling")}, 0.0);
    const std::vector<std::string> names = names_of(decided());
    EXPECT_EQ(names.size(), worth > 8.0 ? 2u : 1u) << worth;
    EXPECT_EQ(std::count(names.begin(), names.end(), "beam_offset"), 1);
  }
}

TEST_F(Decide, NamesThatAreNearlyAsLikelyAsACurveAreSaid) {
  const ActiveEffect along_range = curve(CurveChannel::range, "range", "range");
  for (const double behind : {2.9, 3.1}) {  // nats; one to twenty is 3.0
    add({along_range}, 100.0);
    add({name("settling"), along_range}, 99.0);
    add({name("lever_arm"), name("settling")}, 100.0 - behind);
    add({name("settling")}, 100.0 - behind - 0.1);
    const SearchResult result = decided();
    EXPECT_EQ(result.verdict, Verdict::unexplained);
    EXPECT_EQ(result.nearly_as_likely, behind < 3.0 ? (std::vector<std::string>{"lever_arm", "settling"})
                                                    : std::vector<std::string>());
  }
  add({name("settling")}, 20.0);
  add({name("lever_arm")}, 19.0);
  EXPECT_TRUE(decided().nearly_as_likely.empty()) << "no curve to stand for";
}

TEST_F(Decide, SetsThatWereSeenButNotFittedAreCounted) {
  add({name("settling")}, 20.0);
  table_.front()->proposals = {{{"tilt"}, 5.0, 20.0, false}, {{"settling"}, 20.0, 20.0, true}};
  EXPECT_NEAR(*decided().evidence_omitted, 0.5, 1e-12) << "one, as likely as the one that was fitted";
}

}  // namespace
}  // namespace rangecal::diagnosis
