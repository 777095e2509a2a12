// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/without_readings.hpp"

#include <gtest/gtest.h>

#include <vector>

namespace rangecal {
namespace {

TEST(WithoutReadings, EveryColumnAndTheGroupsLoseTheSameOnes) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.readings.stop = {0, 0, 1};
  recording.readings.landmark = {0, 1, 0};
  recording.readings.range_m = {1.0, 2.0, 3.0};
  recording.readings.row = {2, 3, 4};
  recording.readings.covariates["temperature_c"] = {20.0, 21.0, 22.0};
  recording.groups.of = {0, 0, 1};
  leave_out_readings({0, 1, 0}, recording);
  EXPECT_EQ(recording.readings.stop, (std::vector<int>{0, 1}));
  EXPECT_EQ(recording.readings.landmark, (std::vector<int>{0, 0}));
  EXPECT_EQ(recording.readings.range_m, (std::vector<double>{1.0, 3.0}));
  EXPECT_EQ(recording.readings.row, (std::vector<int>{2, 4}));
  EXPECT_EQ(recording.readings.covariates["temperature_c"], (std::vector<double>{20.0, 22.0}));
  EXPECT_EQ(recording.groups.of, (std::vector<int>{0, 1}));
  EXPECT_TRUE(recording.readings.time_s.empty()) << "a column that the file lacks stays away";
}

TEST(WithoutReadings, OfPairsToo) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.pairs.true_m = {1.0, 2.0};
  recording.pairs.reading_m = {1.1, 2.1};
  recording.pairs.covariates["volts"] = {5.0, 4.9};
  leave_out_readings({1, 0}, recording);
  EXPECT_EQ(recording.pairs.true_m, std::vector<double>{2.0});
  EXPECT_EQ(recording.pairs.reading_m, std::vector<double>{2.1});
  EXPECT_EQ(recording.pairs.covariates["volts"], std::vector<double>{4.9});
}

}  // namespace
}  // namespace rangecal
