// SPDX-License-Identifier: BSD-3-Clause
// Pairs at one, two and three distances, without times or other columns: hardly anything can be asked of them.
#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

Recording pairs_at(const std::vector<double>& distances, int each) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from("diagnosis degenerate", {distances.size()}));
  for (const double d : distances)
    for (int i = 0; i < each; ++i) {
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(random.normal(0.05 + d, 0.005 * d * d));
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
    }
  return recording;
}

TEST(DegenerateDiagnosis, OneDistanceShowsNothing) {
  const std::vector<Recording> recordings{pairs_at({2.0}, 20)};
  const Diagnosis d = diagnose(recordings, {});
  EXPECT_EQ(d.verdict, Verdict::no_mismatch) << d.sentence;
  EXPECT_GT(d.alarm_p_value, 0.02);  // of how the repeats scatter; nothing else can be asked
  for (const Unseen& unseen : d.unseen) EXPECT_TRUE(std::isfinite(unseen.harm_m)) << unseen.effect;
}

TEST(DegenerateDiagnosis, TwoDistancesShowALine) {
  const std::vector<Recording> recordings{pairs_at({2.0, 3.0}, 20)};
  const Diagnosis d = diagnose(recordings, {});
  EXPECT_EQ(d.verdict, Verdict::no_mismatch) << d.sentence;
  EXPECT_EQ(d.baseline.order(), 1);
  for (const Unseen& unseen : d.unseen) EXPECT_TRUE(std::isfinite(unseen.harm_m)) << unseen.effect;
}

TEST(DegenerateDiagnosis, ThreeDistances) {
  const std::vector<Recording> recordings{pairs_at({1.0, 2.0, 3.0}, 20)};
  EXPECT_EQ(diagnose(recordings, {}).verdict, Verdict::no_mismatch);
}

}  // namespace
}  // namespace rangecal
