// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/batch_check.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

/// `count` batches of 30 readings y = d + 0.01 d^2 e at d = 0.5, 0.6, ... m.
Recording batches_of_30(int count, std::uint64_t seed) {
  Random random(seed);
  Recording recording;
  recording.kind = RecordingKind::pairs;
  for (int b = 0; b < count; ++b) {
    const double d = 0.5 + 0.1 * b;
    recording.pairs.batch_labels.push_back(std::to_string(b));
    for (int k = 0; k < 30; ++k) {
      recording.pairs.batch.push_back(b);
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(d + 0.01 * d * d * random.normal());
    }
  }
  return recording;
}

TEST(BatchCheck, CleanBatchesAreLowOneTimeInTwenty) {
  const Recording recordings[] = {batches_of_30(100, seed_from("BatchCheck.Clean", {0})),
                                  batches_of_30(100, seed_from("BatchCheck.Clean", {1}))};
  const auto check = check_batches(recordings);
  ASSERT_TRUE(check);
  EXPECT_EQ(check->batches, 200);
  EXPECT_EQ(check->independence.tested, 200);
  EXPECT_EQ(check->normality.tested, 200);
  // X ~ Bin(200, 0.05): P(X > 20) = 1e-3, P(X < 1) = 4e-5. The runs test is discrete: p < 0.05 comes less often.
  EXPECT_LE(check->independence.low, 20);
  EXPECT_LE(check->normality.low, 20);
  EXPECT_GE(check->normality.low, 1);
  EXPECT_EQ(check->noise.best_power, 2);
}

TEST(BatchCheck, DriftAndOutliersShow) {
  Recording recording = batches_of_30(20, seed_from("BatchCheck.Wrong"));
  for (std::size_t i = 0; i < recording.pairs.size(); ++i) {
    const double sigma = 0.01 * recording.pairs.true_m[i] * recording.pairs.true_m[i];
    recording.pairs.reading_m[i] += 0.2 * sigma * static_cast<double>(i % 30);  // 6 sigma from first to last
  }
  EXPECT_GE(check_batches(std::span(&recording, 1))->independence.low, 18);
  recording = batches_of_30(20, seed_from("BatchCheck.Wrong"));
  for (std::size_t i = 0; i < recording.pairs.size(); i += 30)
    recording.pairs.reading_m[i] += 0.1 * recording.pairs.true_m[i] * recording.pairs.true_m[i];  // 10 sigma
  EXPECT_EQ(check_batches(std::span(&recording, 1))->normality.low, 20);
}

TEST(BatchCheck, NothingWithoutBatches) {
  Recording recording = batches_of_30(3, 1);
  recording.pairs.batch.assign(recording.pairs.size(), -1);
  EXPECT_FALSE(check_batches(std::span(&recording, 1)));
  recording.kind = RecordingKind::landmarks;
  EXPECT_FALSE(check_batches(std::span(&recording, 1)));
}

}  // namespace
}  // namespace rangecal
