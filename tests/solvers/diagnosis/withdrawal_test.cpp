// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/withdrawal.hpp"

#include <gtest/gtest.h>

#include <string>
#include <vector>

#include "rangecal/core/recording_io.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(Withdrawal, TakesTwoStandardErrorsForTheWorse) {
  EXPECT_TRUE(speaks_against({8.1, 4.0}));
  EXPECT_FALSE(speaks_against({7.9, 4.0}));
  EXPECT_FALSE(speaks_against({-80.0, 4.0}));
  EXPECT_FALSE(speaks_against({80.0, std::nullopt}));  // nothing says how sure that is
  EXPECT_FALSE(speaks_against({80.0, 0.0}));
}

Explanation explained_by(const std::string& id, double heldout_nll) {
  Explanation e;
  e.effects = {id};
  e.heldout_nll = heldout_nll;
  e.heldout_std = 4.0;
  return e;
}

Candidate candidate_of(const std::string& id) {
  Candidate c;
  c.fit.model.push_back({find_effect(id), {}});
  return c;
}

/// bearing_drift, or heading_drift; the seed model predicts with 100 nats.
struct Named {
  SearchResult found;
  Diagnosis result;
  Named(double first_nll, double second_nll) {
    found.verdict = Verdict::explained;
    found.best = candidate_of("bearing_drift");
    found.rivals = {candidate_of("heading_drift")};
    result.before.heldout_nll = 100.0;
    result.explanations = {explained_by("bearing_drift", first_nll),
                           explained_by("heading_drift", second_nll)};
    result.explanations[0].indistinguishable_from = {{"heading_drift"}};
  }
};

TEST(Withdrawal, OfTheAnswersNameLeavesOneWithoutAName) {
  Named named(110.0, 60.0);
  EXPECT_EQ(withdraw_names(Rows{}, named.found, named.result),
            "Held-out data speak against bearing_drift: with it, held-out readings are predicted worse by "
            "10.0 +- 4.0 nats, so it is not named.");
  EXPECT_EQ(named.found.verdict, Verdict::unexplained);
  EXPECT_TRUE(named.found.best.fit.model.empty());
  EXPECT_TRUE(named.found.rivals.empty());
}

TEST(Withdrawal, OfAnotherExplanationLeavesTheAnswer) {
  Named named(60.0, 110.0);
  EXPECT_EQ(withdraw_names(Rows{}, named.found, named.result), "");
  EXPECT_EQ(named.found.verdict, Verdict::explained);
  EXPECT_TRUE(named.found.rivals.empty());
  ASSERT_EQ(named.result.explanations.size(), 1u);
  EXPECT_TRUE(named.result.explanations[0].indistinguishable_from.empty());
  ASSERT_EQ(named.result.notes.size(), 1u);
  EXPECT_NE(named.result.notes[0].find("heading_drift"), std::string::npos);
}

TEST(Withdrawal, LeavesWhatPredictsAndWhatWasReadOffTheValues) {
  Named named(60.0, 107.0);  // within two standard errors
  EXPECT_EQ(withdraw_names(Rows{}, named.found, named.result), "");
  EXPECT_EQ(named.result.explanations.size(), 2u);
  Named labels(160.0, 60.0);
  labels.found.best = candidate_of("label_swap");
  EXPECT_EQ(withdraw_names(Rows{}, labels.found, labels.result), "");
  EXPECT_EQ(labels.found.verdict, Verdict::explained);
  Named beside(160.0, 60.0);  // beside what bookkeeping found the density is not the name's alone
  beside.found.known.model = candidate_of("quantisation").fit.model;
  EXPECT_EQ(withdraw_names(Rows{}, beside.found, beside.result), "");
}

TEST(HeldOut, EveryExplanationHasADensityAndItsStandardError) {
  const std::vector<Recording> recordings{
      load_recording(std::string(RANGECAL_SOURCE_DIR) + "/notebooks_data/concealed/world-01")};
  DiagnoseOptions options;
  options.unseen = options.next_experiments = false;
  const Diagnosis d = diagnose(recordings, options);
  ASSERT_EQ(d.explanations.size(), 2u) << d.sentence;
  ASSERT_TRUE(d.before.heldout_nll && d.after.heldout_nll);
  EXPECT_EQ(d.explanations[0].heldout_nll, d.after.heldout_nll);
  for (const Explanation& e : d.explanations) {
    ASSERT_TRUE(e.heldout_nll && e.heldout_std) << e.effects[0];
    EXPECT_GT(*e.heldout_std, 0.0);
    // Both turn the bearings evenly in time, and predict alike: within the error, far better than the seed model.
    EXPECT_NEAR(*e.heldout_nll, *d.after.heldout_nll, *e.heldout_std);
    EXPECT_LT(*e.heldout_nll, *d.before.heldout_nll - 100.0);
  }
}

}  // namespace
}  // namespace rangecal::diagnosis
