// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/location.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <nlohmann/json.hpp>
#include <numbers>
#include <optional>
#include <string>
#include <tuple>
#include <vector>

#include "diagnosis/findings.hpp"
#include "diagnosis/places.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/made_recordings.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(Places, AnIntervalHoldsAllThatIsHalfAsLargeAsTheLargest) {
  // A triangle of height 4 at x = 5 and width 8: 2 or more from 3 to 7; what is missing counts nowhere.
  Eigen::VectorXd x(12), change(12);
  for (int i = 0; i <= 10; ++i) {
    x[i] = 10 - i;
    change[i] = -std::max(0.0, 4.0 - std::abs(x[i] - 5.0));
  }
  x[11] = std::nan(""), change[11] = 100.0;
  const auto interval = interval_of(x, change);
  ASSERT_TRUE(interval);
  EXPECT_DOUBLE_EQ(interval->from, 3.0);
  EXPECT_DOUBLE_EQ(interval->to, 7.0);
  EXPECT_FALSE(interval_of(x, Eigen::VectorXd::Zero(12)));
}

TEST(Places, AlongAnglesMayHoldTheSeam) {
  // A bump of half a radian about 180 degrees, over bearings all around.
  constexpr int count = 126;
  Eigen::VectorXd x(count), change(count);
  for (int i = 0; i < count; ++i) {
    x[i] = -std::numbers::pi + (i + 0.5) * 2.0 * std::numbers::pi / count;
    change[i] = std::max(0.0, 1.0 - std::abs(wrap_angle(x[i] - std::numbers::pi)));
  }
  const auto interval = interval_of(x, change, true);
  ASSERT_TRUE(interval);
  EXPECT_NEAR(interval->from, std::numbers::pi - 0.5, 0.05);
  EXPECT_NEAR(interval->to, -std::numbers::pi + 0.5, 0.05);
  const auto everywhere = interval_of(x, Eigen::VectorXd::Ones(count), true);
  ASSERT_TRUE(everywhere);
  EXPECT_LT(everywhere->from, everywhere->to);
}

TEST(Places, OfBinsCountThoseThatAreLargeAndClear) {
  // 3 is the largest, and clear; 1.6 is half of it, but within two standard errors of 1; 2.5 is both.
  std::vector<BinnedResidual> bins;
  for (const auto& [at, before, std_dev] :
       {std::tuple{1.0, 1.6, 1.0}, {2.0, -3.0, 1.0}, {3.0, 0.1, 1.0}, {4.0, 2.5, 1.0}, {6.0, 1.0, 0.1}})
    bins.push_back({at, before, 0.0, std_dev, 10});
  const auto interval = interval_of(bins);
  ASSERT_TRUE(interval);
  EXPECT_DOUBLE_EQ(interval->from, 1.5);  // half-way to the bin before
  EXPECT_DOUBLE_EQ(interval->to, 5.0);    // half-way to the bin behind
  EXPECT_FALSE(interval_of(std::vector<BinnedResidual>{}));
}

ActiveEffect named(const char* id) { return {find_effect(id), {}}; }

TEST(Location, NamesThatActOnOneCurveAreOneFinding) {
  const auto curves =
      located_curves({named("range_scale"), named("quantisation"), named("lens_distortion"),
                      named("range_eccentricity"), named("bearing_offset"), named("range_offset")});
  ASSERT_EQ(curves.size(), 3u);
  EXPECT_EQ(ids_of(curves[0].effects),
            (std::vector<std::string>{"range_scale", "lens_distortion", "range_offset"}));
  EXPECT_EQ(curves[0].covariate, "range");
  EXPECT_EQ(curves[0].numbers, (std::vector<int>{0, 2, 5}));
  EXPECT_EQ(ids_of(curves[1].effects), std::vector<std::string>{"range_eccentricity"});
  EXPECT_EQ(ids_of(curves[2].effects), std::vector<std::string>{"bearing_offset"});
  // One name keeps its own covariate; errors of the stops and their displacement are no one curve.
  EXPECT_EQ(located_curves({named("pixel_locking")})[0].covariate, "disparity");
  EXPECT_EQ(located_curves({named("odometry_scale"), named("stop_effect")}).size(), 2u);
}

Finding of_p(const char* shape, double log_p, std::optional<double> share) {
  Finding f;
  f.shape = shape;
  f.share = share;
  f.set_log_p(log_p);
  return f;
}

TEST(Location, IsOrderedByPAndThenByShare) {
  std::vector<Finding> location{of_p("fourth", -9.0, 0.1), of_p("second", -2000.0, std::nullopt),
                                of_p("first", -2000.0, 0.4), of_p("fifth", -1.0, 0.9),
                                of_p("third", -1990.0, 1.2)};
  order_location(location);
  std::string order;
  for (const Finding& f : location) order += f.shape + " ";
  EXPECT_EQ(order, "first second third fourth fifth ");
}

TEST(Location, APValueDoesNotUnderflow) {
  Diagnosis d;
  d.baseline.alpha = d.corrected.alpha = Eigen::Vector2d(0.0, 1.0);
  d.location = {of_p("", -2000.0, std::nullopt)};
  EXPECT_EQ(d.location[0].p_value, Finding::least_p_value);
  const auto json = nlohmann::json::parse(diagnosis_to_json(d)).at("location")[0];
  EXPECT_EQ(json.at("p_value"), 1e-300);
  EXPECT_NEAR(json.at("log10_p").get<double>(), -868.589, 1e-3);  // -2000 / ln 10
  EXPECT_TRUE(json.at("share").is_null());
}

/// The line of the 2021 paper, the spin axis 7.5 mm beside the cover's.
Recording eccentric_line() {
  Random random(seed_from("location test", {1}));
  world::World w = world::vary(world::make_line_design(), random);
  w = world::apply(w, "range_eccentricity", 0.0075, random);
  return world::simulate(w, seed_from("location test run", {1}));
}

TEST(Location, WhatAnEffectThatWasAskedForLeavesBelongsToNone) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.force = {{"encoder_ellipticity"}};
  const Recording recording = eccentric_line();
  const Diagnosis d = diagnose({&recording, 1}, options);
  const auto left = std::find_if(d.location.begin(), d.location.end(), [](const Finding& f) {
    return f.channel == "range" && f.covariate == "sensor_bearing";
  });
  ASSERT_NE(left, d.location.end());
  EXPECT_TRUE(left->effects.empty());
  EXPECT_LT(left->p_value, 1e-6);
}

TEST(Location, OfANameItIsItsCurveByTheLikelihoodRatio) {
  const Diagnosis d = testing::verdict_of(eccentric_line());
  ASSERT_EQ(d.final_effects, std::vector<std::string>{"range_eccentricity"}) << d.sentence;
  ASSERT_FALSE(d.location.empty());
  const Finding& first = d.location[0];
  EXPECT_EQ(first.channel + "/" + first.covariate, "range/sensor_bearing");
  // A cosine and a sine, corrected for what was asked: never smaller than without, by thousands at most.
  const double log_p = log_chi_sq_survival(2.0 * (d.before.nll - d.explanations[0].nll), 2);
  EXPECT_GE(first.log_p, log_p);
  EXPECT_LE(first.log_p, log_p + std::log(1e5));
  ASSERT_TRUE(first.from && first.to);
  EXPECT_LT(*first.from, *first.to);
  for (std::size_t i = 0; i < d.location.size(); ++i) {
    EXPECT_EQ(d.location[i].effects, d.final_effects) << i;
    EXPECT_TRUE(d.location[i].from || !d.location[i].group.empty() || !d.location[i].everywhere.empty()) << i;
    EXPECT_GE(d.location[i].p_value, d.location[i > 0 ? i - 1 : 0].p_value) << i;
  }
}

TEST(Location, OfWhatHasNoNameItIsTheIntervalOfItsCurve) {
  const Diagnosis d = testing::verdict_of(testing::depth_camera(900, 0.03, 0.0, "PartlyNamed.Bump"));
  ASSERT_EQ(d.final_effects, (std::vector<std::string>{"axial_depth", "generic"})) << d.sentence;
  int of_name = 0, of_bump = 0;
  for (const Finding& f : d.location) {
    if (f.effects == std::vector<std::string>{"axial_depth"}) {
      ++of_name;
      ASSERT_TRUE(f.from && f.to);
      EXPECT_LT(*f.from, -0.4);
      EXPECT_GT(*f.to, 0.4);
    } else if (f.channel == "range" && f.covariate == "range") {
      ++of_bump;
      EXPECT_EQ(f.effects, std::vector<std::string>{"generic"});
      ASSERT_TRUE(f.from && f.to);
      EXPECT_LT(*f.from, 2.3);
      EXPECT_GT(*f.to, 2.3);
    }
    // One reading at each distance: the spread takes up what the curve leaves, and the excess is within noise.
    EXPECT_FALSE(f.share) << f.channel;
  }
  EXPECT_EQ(of_name, 1);
  EXPECT_EQ(of_bump, 1);
}

TEST(Location, OfOneLandmarkItIsThatLandmark) {
  // Three landmarks, the second read four times as wildly: the noise that all share makes the others too quiet by as much.
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  testing::add_landmarks(recording, 3);
  Random random(seed_from("Location.OfOneLandmark"));
  const std::vector<Eigen::Vector2d> places{{1.5, 1.0}, {2.5, -1.0}, {0.5, -2.0}};
  for (int k = 0; k < 20; ++k) {
    const Pose2 commanded{random.uniform(-0.5, 0.5), random.uniform(-0.5, 0.5), random.uniform(-3.0, 3.0)};
    testing::add_stop(recording, commanded, 0.01);
    const Eigen::Vector2d at(random.normal(commanded.x_m, 0.01), random.normal(commanded.y_m, 0.01));
    for (int l = 0; l < 3; ++l) {
      const Eigen::Vector2d way = places[static_cast<std::size_t>(l)] - at;
      const double bearing = wrap_angle(std::atan2(way.y(), way.x()) - commanded.heading_rad), f = way.norm();
      for (int i = 0; i < (l == 1 ? 16 : 8); ++i)
        testing::add_reading(recording, k, l, i, random.normal(f, (l == 1 ? 0.02 : 0.005) * f * f),
                             wrap_angle(bearing + random.normal(0.0, 0.0087)));
    }
  }
  const Diagnosis found = testing::verdict_of(recording);
  ASSERT_EQ(found.final_effects, std::vector<std::string>{"dark_target"}) << found.sentence;
  ASSERT_FALSE(found.location.empty());
  EXPECT_EQ(found.location[0].group, recording.landmarks[1].label);
}

TEST(Location, AnAlarmOfOneEffectAloneHasAPlace) {
  const Recording recording = testing::depth_camera(400, 0.0, 0.0, "PartlyNamed.Alone");
  const Rows rows = make_rows(std::span(&recording, 1));
  RefitOptions refit_options;
  const Fit baseline = fit_baseline(rows, DiagnoseOptions{}, refit_options);
  Battery battery(rows, {}, baseline.state);
  std::erase_if(battery.questions, [](const Question& q) { return !q.effect; });
  ASSERT_FALSE(battery.questions.empty());
  battery.questions.resize(1);
  battery.questions[0].log_p = -50.0;
  const std::vector<Question> found = findings(rows, battery, 0.02);
  ASSERT_EQ(found.size(), 1u);
  EXPECT_EQ(found[0].effect, battery.questions[0].effect);
  battery.questions[0].log_p = -0.1;
  EXPECT_TRUE(findings(rows, battery, 0.02).empty());
}

}  // namespace
}  // namespace rangecal::diagnosis
