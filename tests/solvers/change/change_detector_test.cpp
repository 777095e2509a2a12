// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/change_detector.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <map>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

Calibration pairs_reference() {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector3d(0.0525, 0.8838, 0.0584);
  c.noise.parameters[0] = 0.01;
  c.range_min_m = 0.5;
  c.range_max_m = 4.0;
  return c;
}

/// A reading at a distance of the range, with the mean and spread changed.
double read(Random& random, double d, double offset = 0.0, double scale = 1.0, double disparity = 0.0,
            double spread = 1.0) {
  const Calibration c = pairs_reference();
  const double f = evaluate_polynomial(c.alpha, d);
  return random.normal(scale * f + offset + disparity * f * f, spread * 0.01 * f * f);
}

TEST(ChangeDetector, LimitHandWorked) {
  // D = 0.125 (shift 0.5): h' of e^h' - h' - 1 = 1000 * 0.125 is 4.8789 (e^4.8789 = 131.49; 131.49 - 5.88 = 125.6; at
  // 4.8746 125.05; 4.8742 125.0), less 1.166 * 0.5.
  EXPECT_NEAR(cusum_limit(1000.0, 0.125), 4.8742 - 0.583, 1e-3);
}

TEST(ChangeDetector, OneChartHasTheRunLengthOfItsLimit) {
  // The plain chart S <- max(0, S + b z - b^2 / 2) at b = 0.5: 1500 runs of mean 1000, standard error 2.6 %; 4 of them, and
  // some 2 % for Siegmund's approximation.
  Random random(seed_from("one chart"));
  const double h = cusum_limit(1000.0, 0.125);
  double readings = 0.0;
  constexpr int runs = 1500;
  for (int i = 0; i < runs; ++i)
    for (double S = 0.0; S <= h; readings += 1.0) S = std::max(0.0, S + 0.5 * random.normal() - 0.125);
  EXPECT_NEAR(readings / runs, 1000.0, 125.0);
}

TEST(ChangeDetector, RunLengthIsAtLeastAsStated) {
  ChangeOptions options;
  options.run_length = 2000.0;
  options.naming = 10;  // no alarm is raised meanwhile
  options.bearings = true;
  ChangeDetector detector(pairs_reference(), options);
  Random random(seed_from("run length"));
  int alarms = 0;
  constexpr int readings = 1000000;
  for (int i = 0; i < readings; ++i) {
    const double d = random.uniform(0.5, 4.0);
    const auto alarm = detector.add(d, read(random, d), random.uniform(-3.14, 3.14));
    alarms += alarm && !alarm->named;
  }
  // 500 stated; a Poisson number of alarms has a deviation of 22. Correlated charts alarm together: fewer, but not by more
  // than the number of sorts (5) says.
  EXPECT_LT(alarms, 500 + 4 * 22);
  EXPECT_GT(alarms, 100);
}

TEST(ChangeDetector, NamesWhatChangedWithItsSize) {
  struct Case {
    ChangeKind kind;
    double offset, scale, disparity, spread, size;
  };
  for (const Case& c : {Case{ChangeKind::window, 0.02, 1.0, 0.0, 1.0, 0.02},
                        Case{ChangeKind::baseline, 0.0, 1.03, 0.0, 1.0, 0.03},
                        Case{ChangeKind::pointing, 0.0, 1.0, 0.01, 1.0, 0.01},
                        Case{ChangeKind::noise, 0.0, 1.0, 0.0, 2.0, std::log(2.0)},
                        Case{ChangeKind::window, -0.02, 1.0, 0.0, 1.0, -0.02},
                        Case{ChangeKind::noise, 0.0, 1.0, 0.0, 0.5, -std::log(2.0)}}) {
    int named = 0, covered = 0, since = 0, found = 0;
    for (std::uint64_t repeat = 0; repeat < 60; ++repeat) {
      ChangeDetector detector(pairs_reference());
      Random random(seed_from("change", {repeat}));
      for (int i = 0; i < 1000; ++i) {
        const bool after = i >= 500;
        const double d = random.uniform(0.5, 4.0);
        const double y = after ? read(random, d, c.offset, c.scale, c.disparity, c.spread) : read(random, d);
        const auto alarm = detector.add(d, y);
        if (!alarm || !alarm->named) continue;
        ++found;
        named += alarm->kind == c.kind;
        covered += alarm->kind == c.kind && std::abs(alarm->size - c.size) < 3.0 * alarm->std_dev;
        since += std::abs(alarm->since - 500) < 60;
        break;
      }
    }
    EXPECT_EQ(found, 60) << to_string(c.kind);
    // Neighbouring directions are alike, hence not all: 85 % asked.
    EXPECT_GT(named, 51) << to_string(c.kind) << " " << c.size;
    EXPECT_GT(covered, 0.85 * named) << to_string(c.kind);
    EXPECT_GT(since, 48) << to_string(c.kind);
  }
}

TEST(ChangeDetector, SeesTheEncoderByItsBearing) {
  ChangeOptions options;
  options.bearings = true;
  ChangeDetector detector(pairs_reference(), options);
  Random random(seed_from("encoder"));
  std::optional<ChangeAlarm> alarm;
  for (int i = 0; i < 2000 && !(alarm && alarm->named); ++i) {
    const double d = random.uniform(0.5, 4.0), bearing = random.uniform(-3.14, 3.14);
    alarm = detector.add(d, read(random, d, i < 300 ? 0.0 : 0.02 * std::sin(bearing)), bearing);
  }
  ASSERT_TRUE(alarm);
  EXPECT_EQ(alarm->kind, ChangeKind::encoder);
  EXPECT_GT(alarm->reading, 300);
}

TEST(ChangeDetector, StateGoesOnAndBadInputIsRefused) {
  ChangeDetector a(pairs_reference()), b(pairs_reference()), whole(pairs_reference());
  Random random(seed_from("state"));
  for (int i = 0; i < 400; ++i) {
    const double d = random.uniform(0.5, 4.0), y = read(random, d);
    whole.add(d, y);
    (i < 200 ? a : b).add(d, y);
    if (i == 199) b.restore(a.state());
  }
  EXPECT_EQ(b.state(), whole.state());
  EXPECT_FALSE(a.add(1.0, std::nan("")));
  EXPECT_FALSE(a.add(1.0, -1.0));
  EXPECT_THROW(a.restore({1.0}), InputError);
  EXPECT_THROW(ChangeDetector(Calibration{}), InputError);
  ChangeOptions bad;
  bad.run_length = 1.0;
  EXPECT_THROW(ChangeDetector(pairs_reference(), bad), InputError);
}

}  // namespace
}  // namespace rangecal
