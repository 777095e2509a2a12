// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <string>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {
namespace {

/// 200 pairs between half a metre and four, an offset and a scale beside a noise of 1 % of the range, and a
/// wobble in 1/d of `pull_per_m` d^2.
Recording pairs_with_wobble(double pull_per_m, const std::string& name, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from(name, {seed}));
  for (int i = 0; i < 200; ++i) {
    const double d = random.uniform(0.5, 4.0);
    const double f = 0.03 + 0.98 * d + pull_per_m * d * d * std::sin(400.0 / d);
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + 0.01 * d * random.normal());
    recording.pairs.bearing_rad.push_back(0.0);
    recording.pairs.time_s.push_back(i);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

/// Change of the held-out NLL by `pixel_locking`, fitted as asked, whose period is chosen among hundreds.
double change_by_pixel_locking(const Recording& recording) {
  DiagnoseOptions options;
  options.force = {{"pixel_locking"}};
  options.unseen = options.next_experiments = false;
  const Diagnosis d = diagnose(std::span(&recording, 1), options);
  if (!d.before.heldout_nll || !d.after.heldout_nll) return std::nan("");
  return *d.after.heldout_nll - *d.before.heldout_nll;
}

TEST(HeldOut, APeriodChosenFromNoiseDoesNotPredict) {
  // Chosen on all readings the period knows those that are held out, and gained 1.9 nats a recording here.
  // Chosen anew in every training part it loses: what is fitted to noise can only mislead. Ten recordings'
  // losses scatter by 20 nats about their sum.
  double sum = 0.0;
  for (std::uint64_t seed = 1; seed <= 10; ++seed)
    sum += change_by_pixel_locking(pairs_with_wobble(0.0, "HeldOut.Noise", seed));
  EXPECT_GT(sum, 10.0);
}

TEST(HeldOut, APeriodThatIsThereIsFoundInEveryPartAndPredicts) {
  EXPECT_LT(change_by_pixel_locking(pairs_with_wobble(0.01, "HeldOut.Wobble", 1)), -20.0);
}

/// 12 settings of 40 readings each, every setting at a distance and an elevation of its own and off by an error of its own of
/// 30 mm; noise 10 mm.
Recording settings_of_their_own(const std::string& name, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from(name, {seed}));
  for (int s = 0; s < 12; ++s) {
    const double d = 1.0 + 0.4 * s, elevation = random.uniform(-0.5, 0.5), off = 0.03 * random.normal();
    recording.pairs.batch_labels.push_back("setting " + std::to_string(s));
    for (int i = 0; i < 40; ++i) {
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(d + off + 0.01 * random.normal());
      recording.pairs.batch.push_back(s);
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
      recording.pairs.covariates["elevation_rad"].push_back(elevation);
    }
  }
  return recording;
}

TEST(HeldOut, AKnotForEverySettingPredictsNoSettingThatWasLeftOut) {
  // A curve along the elevation passes through all twelve means. Of a setting that was left out it knows nothing.
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const Recording recording = settings_of_their_own("HeldOut.Settings", seed);
    DiagnoseOptions options;
    options.unseen = options.next_experiments = false;
    const Diagnosis d = diagnose(std::span(&recording, 1), options);
    EXPECT_EQ(d.heldout_blocks, "batches");
    EXPECT_DOUBLE_EQ(d.heldout_effective_blocks, 12.0);
    ASSERT_TRUE(d.before.heldout_nll && d.after.heldout_nll) << seed;
    // That settings differ, each by an error of its own, is another matter: then their spread is known.
    const auto& names = d.final_effects;
    if (std::find(names.begin(), names.end(), "cell_effect") != names.end()) continue;
    // By its own readings it gains 12 x 40 x (0.03 / 0.01)^2 / 2 = 2160 nats where sigma is known.
    EXPECT_GT(*d.after.heldout_nll, *d.before.heldout_nll - 10.0) << seed;
    ASSERT_TRUE(d.before.heldout_rms_range_m && d.after.heldout_rms_range_m);
    EXPECT_GT(*d.after.heldout_rms_range_m, 0.9 * *d.before.heldout_rms_range_m) << seed;
  }
}

TEST(HeldOut, GroupsThatAreStatedAreLeftOutWhole) {
  Recording recording = settings_of_their_own("HeldOut.Groups", 1);
  recording.groups.by = {"day", "robot"};
  for (std::size_t i = 0; i < recording.pairs.size(); ++i)
    recording.groups.of.push_back(static_cast<int>(i / 120));  // four days of three settings
  recording.groups.labels.assign(4, {"day", "robot"});
  DiagnoseOptions options;
  options.unseen = options.next_experiments = false;
  const Diagnosis d = diagnose(std::span(&recording, 1), options);
  EXPECT_EQ(d.heldout_blocks, "groups of day and robot");
  EXPECT_DOUBLE_EQ(d.heldout_effective_blocks, 4.0);
}

/// Eight devices in turn over 50 readings each, every other one off by 30 mm up or down; noise 10 mm.
Recording devices(const std::string& name, std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = "made";
  Random random(seed_from(name, {seed}));
  for (int l = 0; l < 8; ++l) {
    recording.landmarks.push_back({"D" + std::to_string(l), 0.0, {}});
    for (int i = 0; i < 50; ++i) {
      const double d = random.uniform(1.0, 5.0);
      recording.pairs.true_m.push_back(d);
      recording.pairs.reading_m.push_back(d + (l % 2 == 0 ? 0.03 : -0.03) + 0.01 * random.normal());
      recording.pairs.landmark.push_back(l);
      recording.pairs.row.push_back(static_cast<int>(recording.pairs.row.size()) + 2);
      recording.groups.of.push_back(l);
    }
    recording.groups.labels.push_back({"D" + std::to_string(l)});
  }
  recording.groups.by = {"landmark"};
  return recording;
}

TEST(HeldOut, AnOffsetOfADeviceThatWasLeftOutIsNotKnown) {
  // Known from its own readings, the offsets gain 400 ln(0.032 / 0.01) = 460 nats. Left out, a device is off by 30 mm, three times
  // the noise that the other devices' offsets leave.
  const Recording recording = devices("HeldOut.Devices", 1);
  DiagnoseOptions options;
  options.force = {{"device_offset"}};
  options.unseen = options.next_experiments = false;
  const Diagnosis d = diagnose(std::span(&recording, 1), options);
  ASSERT_TRUE(d.before.heldout_nll && d.after.heldout_nll);
  EXPECT_GT(*d.after.heldout_nll, *d.before.heldout_nll);
}

}  // namespace
}  // namespace rangecal
