// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/held_recordings.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <string>
#include <vector>

#include "diagnosis/search.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "support/add_reading.hpp"

namespace rangecal::diagnosis {
namespace {

/// Pairs of a sensor whose cover adds `cover_m` cos b, with a noise of 1 % of the distance.
Recording pairs_through_cover(int count, double low_m, double high_m, double cover_m, const std::string& name,
                              std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.path = name + std::to_string(seed);
  Random random(seed_from(name, {seed}));
  for (int i = 0; i < count; ++i) {
    const double d = random.uniform(low_m, high_m), b = random.uniform(-std::numbers::pi, std::numbers::pi);
    recording.pairs.true_m.push_back(d);
    recording.pairs.bearing_rad.push_back(b);
    recording.pairs.reading_m.push_back(0.03 + 0.98 * d + cover_m * std::cos(b) + 0.01 * d * random.normal());
    recording.pairs.time_s.push_back(i);
    recording.pairs.row.push_back(i + 2);
  }
  return recording;
}

/// The same sensor among four poles: ten stops known to a centimetre, four repeats.
Recording room_through_cover(double cover_m, const std::string& name, std::uint64_t seed) {
  const std::vector<Eigen::Vector2d> poles{{1.6, 0.9}, {-1.2, 1.9}, {-2.4, -1.1}, {0.8, -2.6}};
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = name + std::to_string(seed);
  testing::add_landmarks(recording, poles.size());
  Random random(seed_from(name, {seed}));
  for (int k = 0; k < 10; ++k) {
    const Pose2 commanded{random.uniform(-0.6, 0.6), random.uniform(-0.6, 0.6),
                          random.uniform(-std::numbers::pi, std::numbers::pi)};
    testing::add_stop(recording, commanded, 0.01);
    const Eigen::Vector2d at(random.normal(commanded.x_m, 0.01), random.normal(commanded.y_m, 0.01));
    for (std::size_t l = 0; l < poles.size(); ++l) {
      const Eigen::Vector2d way = poles[l] - at;
      const double d = way.norm(), f = 0.05 + d * (0.9 + 0.05 * d);
      const double b = wrap_angle(std::atan2(way.y(), way.x()) - commanded.heading_rad);
      for (int i = 0; i < 4; ++i)
        testing::add_reading(recording, k, static_cast<int>(l), i,
                             random.normal(f + cover_m * std::cos(b), 0.002 * f * f),
                             wrap_angle(random.normal(b, 0.009)));
    }
  }
  return recording;
}

Diagnosis forced_on(const std::vector<Recording>& recordings, const std::string& effect) {
  DiagnoseOptions options;
  options.force = {{effect}};
  options.unseen = options.next_experiments = false;
  return diagnose(recordings, options);
}

double held_out_gain(const Diagnosis& d) {
  if (!d.before.heldout_nll || !d.after.heldout_nll) return std::nan("");
  return *d.before.heldout_nll - *d.after.heldout_nll;
}

bool notes_say(const Diagnosis& d, const std::string& words) {
  return std::any_of(d.notes.begin(), d.notes.end(),
                     [&](const std::string& note) { return note.find(words) != std::string::npos; });
}

TEST(HeldRecordings, ACoverIsPredictedFromTheOtherPairs) {
  // 200 readings, 2 cm beside a noise of 2 cm: about 100 nats.
  const Diagnosis d = forced_on({pairs_through_cover(100, 0.5, 4.0, 0.02, "HeldRecordings.Pairs", 1),
                                 pairs_through_cover(100, 0.5, 4.0, 0.02, "HeldRecordings.Pairs", 2)},
                                "range_eccentricity");
  EXPECT_EQ(d.heldout_blocks, "recordings");
  EXPECT_GT(held_out_gain(d), 20.0);
  ASSERT_TRUE(d.after.heldout_std);
  EXPECT_GT(*d.after.heldout_std, 0.0);
  EXPECT_TRUE(notes_say(d, "whole recordings, each of 2 in turn; standard errors are of stretches"));
  EXPECT_NE(diagnosis_to_json(d).find("\"heldout_blocks\": \"recordings\""), std::string::npos);
}

TEST(HeldRecordings, ACoverIsPredictedInARoomFromAnother) {
  const Diagnosis d = forced_on({room_through_cover(0.03, "HeldRecordings.Room", 1),
                                 room_through_cover(0.03, "HeldRecordings.Room", 2)},
                                "range_eccentricity");
  EXPECT_EQ(d.heldout_blocks, "recordings");
  EXPECT_GT(held_out_gain(d), 20.0);
  EXPECT_TRUE(notes_say(d, "its stops and landmarks integrated"));
}

TEST(HeldRecordings, WhatBelongsToOneRecordingIsAskedAboutByStops) {
  const Diagnosis d = forced_on(
      {room_through_cover(0.0, "HeldRecordings.Dark", 1), room_through_cover(0.0, "HeldRecordings.Dark", 2)},
      "dark_target");
  EXPECT_EQ(d.heldout_blocks, "stops");
  EXPECT_TRUE(notes_say(d, "not whole recordings: other recordings say nothing of dark_target in one"));
}

TEST(HeldRecordings, NoCurveIsAskedBeyondItsDistances) {
  const Diagnosis d = forced_on({pairs_through_cover(60, 0.5, 2.0, 0.02, "HeldRecordings.Near", 1),
                                 pairs_through_cover(60, 2.5, 4.0, 0.02, "HeldRecordings.Far", 1)},
                                "range_eccentricity");
  EXPECT_EQ(d.heldout_blocks, "stretches");
  EXPECT_TRUE(notes_say(d, "the recordings do not cover one another's distances"));
}

TEST(HeldRecordings, OfOneRecordingPartsAre) {
  const Diagnosis d =
      forced_on({pairs_through_cover(100, 0.5, 4.0, 0.02, "HeldRecordings.One", 1)}, "range_eccentricity");
  EXPECT_TRUE(d.after.heldout_nll);
  EXPECT_EQ(d.heldout_blocks, "stretches");
  EXPECT_FALSE(notes_say(d, "held out:"));
}

/// Held-out NLL of two recordings without and with a cover.
struct TwoPredictions {
  HeldOut without, with;
  explicit TwoPredictions(const std::vector<Recording>& recordings) {
    const Rows rows = make_rows(recordings);
    RefitOptions options;
    const Fit seed = fit_baseline(rows, DiagnoseOptions{}, options);
    const Model cover{{find_effect("range_eccentricity"), Eigen::VectorXd(Eigen::VectorXd::Zero(2))}};
    const Fit more = refit(rows, cover, seed.state, options);
    without = predict_recordings(rows, seed, Rates{}, options);
    with = predict_recordings(rows, more, Rates{}, options);
  }
};

TEST(HeldRecordings, ANeedlessEffectPredictsWorse) {
  // Two parameters, estimated from one recording at a and from the other at b, both N(0, 1) in units of their errors:
  // each loses (a^2 + b^2)/2 - 2 a b, 1 on average with variance 5. Forty pairs lose 80 +- 20 nats in all.
  double loss = 0.0;
  for (std::uint64_t seed = 0; seed < 40; ++seed) {
    const TwoPredictions held({pairs_through_cover(60, 0.5, 4.0, 0.0, "HeldRecordings.Clean", 2 * seed),
                               pairs_through_cover(60, 0.5, 4.0, 0.0, "HeldRecordings.Clean", 2 * seed + 1)});
    ASSERT_TRUE(held.without.ok && held.with.ok) << seed;
    loss += held.with.nll - held.without.nll;
  }
  EXPECT_GT(loss, 10.0);
  EXPECT_LT(loss, 150.0);
}

TEST(HeldRecordings, PartsOfPairsAddUp) {
  const TwoPredictions held({pairs_through_cover(60, 0.5, 4.0, 0.0, "HeldRecordings.Parts", 1),
                             pairs_through_cover(60, 0.5, 4.0, 0.0, "HeldRecordings.Parts", 2)});
  EXPECT_EQ(held.with.parts.size(), held.without.parts.size());
  EXPECT_GT(held.with.parts.size(), 20u);  // forty asked for, 25 blocks to a recording
  EXPECT_NEAR(std::accumulate(held.with.parts.begin(), held.with.parts.end(), 0.0), held.with.nll, 1e-6);
}

JointState state_in_a_room(const Rows& rows) {
  JointState state;
  state.alpha = Eigen::Vector3d(0.05, 0.9, 0.05);
  state.noise.law = NoiseLaw::f_squared;
  state.noise.parameters = Eigen::VectorXd::Constant(1, 0.002);
  state.sigma_theta_rad = 0.009;
  for (const StopPrior& prior : rows.problem.stops) state.stops.push_back(prior.commanded);
  return state;
}

TEST(HeldRecordings, EachRecordingHasItsOwnStopsAndLandmarks) {
  // Given curve, noise and landmarks two recordings are independent: their densities multiply.
  const std::vector<Recording> recordings{room_through_cover(0.0, "HeldRecordings.Own", 1),
                                          room_through_cover(0.0, "HeldRecordings.Own", 2)};
  const Rows rows = make_rows(recordings);
  JointState state = state_in_a_room(rows);
  for (int i = 0; i < 2; ++i)
    for (const Eigen::Vector2d& pole :
         std::vector<Eigen::Vector2d>{{1.6, 0.9}, {-1.2, 1.9}, {-2.4, -1.1}, {0.8, -2.6}})
      state.landmarks.push_back(pole + Eigen::Vector2d(0.01 * i, 0.0));
  double sum = 0.0;
  for (const bool first : {true, false}) {
    JointState at = state;
    const Rows part = of_recordings(rows, {static_cast<char>(first), static_cast<char>(!first)}, at);
    EXPECT_EQ(part.size(), 160u);
    EXPECT_EQ(part.problem.stop_count(), 10);
    EXPECT_EQ(part.problem.place_count, 10);
    EXPECT_EQ(part.context.landmark_count, 4);
    EXPECT_EQ(at.landmarks.size(), 4u);
    sum += laplace_value(part, {}, at);
  }
  JointState all = state;
  EXPECT_NEAR(sum, laplace_value(rows, {}, all), 1e-6);
}

TEST(HeldRecordings, TheDensityIsTheIntegralOverTheLandmark) {
  // Three exact stops, one landmark: over its place the density is summed on a grid of millimetres, to 9 cm (nine
  // standard deviations) about it. What is not Gaussian in it is of the order of (1 cm / 2 m)^2.
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  testing::add_landmarks(recording, 1);
  const Eigen::Vector2d pole(2.0, 0.5);
  Random random(seed_from("HeldRecordings.Integral", {1}));
  for (const Pose2& stop : {Pose2{0.0, 0.0, 0.0}, Pose2{0.5, 0.3, 0.4}, Pose2{0.3, -0.6, -0.2}}) {
    testing::add_stop(recording, stop, 0.0, 0.0);
    const Eigen::Vector2d way = pole - Eigen::Vector2d(stop.x_m, stop.y_m);
    for (int i = 0; i < 2; ++i)
      testing::add_reading(recording, static_cast<int>(recording.stops.size()) - 1, 0, i,
                           random.normal(0.05 + 0.98 * way.norm(), 0.02),
                           random.normal(std::atan2(way.y(), way.x()) - stop.heading_rad, 0.01));
  }
  const Rows rows = make_rows({&recording, 1});
  JointState state = state_in_a_room(rows);
  state.alpha = Eigen::Vector2d(0.05, 0.98);
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters[0] = 0.02;
  state.sigma_theta_rad = 0.01;
  state.landmarks = {pole};
  const double least = joint_nll(rows.problem, state);
  double integral = 0.0;
  JointState at = state;
  for (int i = -90; i <= 90; ++i)
    for (int j = -90; j <= 90; ++j) {
      at.landmarks[0] = pole + 1e-3 * Eigen::Vector2d(i, j);
      integral += 1e-6 * std::exp(least - joint_nll(rows.problem, at));
    }
  EXPECT_NEAR(predictive_nll(rows, {}, state), least - std::log(integral), 2e-3);
}

}  // namespace
}  // namespace rangecal::diagnosis
