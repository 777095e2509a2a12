// SPDX-License-Identifier: BSD-3-Clause
// The battery of benchmarks/hard_problems.cpp in small, and the worlds of the large one that once got a wrong
// answer.
#include <gtest/gtest.h>

#include "hard/judge.hpp"

namespace rangecal {
namespace {

void expect_honest(std::uint64_t id, bool ask_nlopt) {
  for (const hard::Judgement& j : hard::judge(hard::make_world(id), ask_nlopt)) {
    EXPECT_EQ(j.violation, "") << "world " << id << " by " << to_string(j.method) << ": " << j.outcome;
    EXPECT_NE(j.outcome, "refused") << "world " << id << ": " << j.reason;
  }
}

TEST(HardProblems, EveryAnswerIsWhatItSaysAndNothingIsPrinted) {
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  for (std::uint64_t id = 0; id < 200; ++id) expect_honest(id, id % 50 == 0);
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
  ::testing::internal::GetCapturedStdout();  // of the test itself
}

TEST(HardProblems, WorldsThatOnceGotAWrongAnswer) {
  // 733: called converged at a kink of the wrapped bearings; 709, 175: marginal 37 and 160 nats above its
  // seed; 564: flat.
  for (std::uint64_t id : {733, 709, 175, 564}) expect_honest(id, false);
}

TEST(HardProblems, ExactReadingsAreSolvedThoughSumsOfSquaresRoundAwayWhatIsLeftToGain) {
  // Noise of 1e-9 to 1e-5: a sigma that falls so far below the seed's is no collapse, and Ceres cannot
  // compare the sums.
  for (std::uint64_t id : {47, 67}) {
    const std::vector<hard::Judgement> judgements = hard::judge(hard::make_world(id), false);
    EXPECT_EQ(judgements.at(0).outcome, "converged") << id << ": " << judgements[0].reason;
  }
}

}  // namespace
}  // namespace rangecal
