// SPDX-License-Identifier: BSD-3-Clause
// One hand-worked value per effect, for the reading of example.hpp. Before the curve: f(d + x) - f(d) = x
// (0.9 + 0.05 x).
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <string>
#include <vector>

#include "problems/effects/example.hpp"
#include "rangecal/problems/effects/reading_chain.hpp"

namespace rangecal {
namespace {

using effects_testing::example_context;
using effects_testing::example_reading;

constexpr double pi = std::numbers::pi;

struct Case {
  std::string id;
  std::vector<double> p;
  ReadingChange<double> expected;
};

std::vector<Case> cases() {
  const double half = std::numbers::ln2;
  return {
      // x = -0.1 * 2 * (1 - cos 60 deg) = -0.1: -0.09 + 0.05 * 0.01
      {"axial_depth", {0.1, 0.0}, {.range = -0.0895}},
      {"mixed_pixels", {0.002, 0.01}, {}},  // a tail: see DependenceAndTails
      {"range_offset", {0.005}, {.range = 0.005}},
      // x = 0.2 * 0.12 = 0.024: 0.0216 + 0.05 * 0.000576
      {"arc_definition", {0.2}, {.range = 0.0216288}},
      // x = -0.05 * 0.12 = -0.006: -0.0054 + 0.05 * 0.000036
      {"radius_scale", {0.05}, {.range = -0.0053982}},
      {"range_scale", {0.0015, 0.0}, {.range = 0.003}},   // 0.0015 * 2
      {"range_scale", {0.0015, 1.0}, {.range = 0.0045}},  // 0.0015 / 10 * (35 - 20) * 2
      // (0.001 + 0.0002 * 2) (35 - 25); 0.002 (-74 + 70); z = 2: (0.003 + 0.001 * 2) 2 + 0.002 (4 - 1)
      {"temperature_coefficient:temperature_c", {0.001, 0.0002, 25.0}, {.range = 0.014}},
      {"power_bias:rx_power_dbm", {0.002, -70.0}, {.range = -0.008}},
      {"covariate_drift:intensity", {0.003, 0.001, 0.002, 100.0, 10.0}, {.range = 0.016}},
      {"device_offset", {0.012, 0.5, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0}, {.range = 0.012}},  // landmark 1
      // a = 30 degrees: 0.01 sin a + 0.02 cos 2 a + 0.03 cos 3 a + 0.04 sin 3 a = 0.005 + 0.01 + 0 + 0.04
      {"antenna_pattern:elevation_rad", {0.0, 0.01, 0.02, 0.0, 0.03, 0.04, 0, 0, 0, 0}, {.range = 0.055}},
      {"range_saturation", {0.4, 2.0 / half}, {.range = 0.2}},  // d / D = ln 2: half of it
      {"laser_pointing", {0.002}, {.range = 0.008}},            // 0.002 * 4
      {"lens_distortion", {0.002}, {.range = 0.001}},           // 0.002 / 2
      // k / d = 100.5 pi: cos = 0, sin = 1; q = 1e-5 sqrt(5) 201 pi / 2 = 0.0071: the second term is 2e-7 of the first; 4 * 2e-5
      {"pixel_locking", {1e-5, 2e-5, 201.0 * pi}, {.range = 8e-5}},
      // steps 2.1^2 * 0.005 = 0.02205 and 0.01: (0.0004862025 + 0.0001) / (12 * 0.0004) = 0.1221255208
      {"quantisation", {0.005, 0.01}, {.range_log_variance = std::log(1.12212552083333)}},
      {"near_regime", {0.005, 0.02, 2.5}, {.range = -0.005}},  // 0.005 + 0.02 * (2 - 2.5)
      {"near_regime", {0.005, 0.02, 1.5}, {}},                 // beyond the limit
      {"target_reflectance", {0.015, 1.0, 0.0}, {.range = 0.015}},
      {"target_reflectance", {0.015, 1.0, 2.0}, {.range = 0.06}},  // 0.015 * 4
      {"target_reflectance", {0.015, 0.0, 2.0}, {}},               // another landmark
      {"dark_target", {1.4, 1.0}, {.range_log_variance = 1.4}},
      {"dark_target", {1.4, 2.0}, {}},
      // 0.2 rad from the sector's middle: 0.0005 * 4
      {"ambient_light", {1.2, 0.0005, pi / 3 + 0.2, 0.5}, {.range = 0.002, .range_log_variance = 1.2}},
      {"ambient_light", {1.2, 0.0005, pi / 3 - 2 * pi - 0.6, 0.5}, {}},
      // error 2 / 0.05 * 0.001 = 0.04, share 0.002 / 0.12 = 1/60: 0.0016 / 60 / 0.0004 = 1/15
      // k = 1 / cos 0.0871779789: x = 2 (hypot(cos 60, k sin 60) - 1) = 0.0057208229; atan(k tan 60) - 60 deg
      {"tilt", {0.0076, 0.0}, {.range = 0.0051503770, .bearing = 0.0016459676}},
      // t / T = ln 2: (0.01 + 0.0025 * 4) / 2
      {"warmup_drift", {0.01, 0.0025, 100.0 / half}, {.range = 0.01}},
      {"range_eccentricity", {0.006, 0.004}, {.range = 0.003 + 0.004 * 0.8660254037844386}},
      // cos 180 = -1: x = 0.12 * 0.05 = 0.006; 0.0054 + 0.05 * 0.000036
      {"landmark_shape", {0.05, 0.02, 1.0}, {.range = 0.0054018}},
      {"landmark_shape", {0.05, 0.02, 0.0}, {}},
      {"cyclic_error", {0.003, 0.004, pi / 4}, {.range = 0.004}},  // k d = pi / 2
      // x = -0.005: -0.0045 + 0.05 * 0.000025
      {"landmark_radius", {0.005, 1.0}, {.range = -0.00449875}},
      {"landmark_radius", {0.005, 2.0}, {}},
      {"bearing_offset", {0.0175}, {.bearing = 0.0175}},
      {"bearing_drift", {0.02}, {.bearing = 0.005}},  // 0.02 * 0.25
      // q / D = 0.01: asin = 0.01 + 0.01^3 / 6 + 3 / 40 * 0.01^5
      {"beam_offset", {0.0212, 0.03}, {.bearing = 0.03 - 0.0100001666741667}},
      {"encoder_eccentricity", {0.004, 0.002}, {.bearing = 0.004 * 0.8660254037844386 + 0.001}},
      {"encoder_ellipticity", {0.004, 0.002}, {.bearing = 0.004 * 0.8660254037844386 - 0.001}},
      {"bearing_scale", {0.006}, {.bearing = 0.002 * pi}},  // 0.006 * pi / 3
      // delta b = atan2(0.8660254038 w, 2.12 - 0.5 w), w = 0.01 + 0.06 delta b / (2 pi): 0.01003925498, 0.004110771421;
      // hypot(2.12 - 0.5 w, 0.8660254038 w) = 2.114998242574, x = -0.005001757426: -0.004501581683 + 0.05 * 0.0000250175773
      {"sweep_motion", {0.06}, {.range = -0.00450033080425, .bearing = 0.00411077142072}},
      {"settling", {0.02, 2.0 / half}, {.bearing = -0.01}},  // 2 s after the stop's first: t / T = ln 2
      // z = 0: lambda = sqrt(2 / pi) = 0.7978845608; variance 1 - 2 / pi
      {"dropout", {2.1}, {.range = -0.015957691216, .range_log_variance = std::log(1.0 - 2.0 / pi)}},
      {"dropout", {3.0}, {}},  // 45 standard deviations away
      // 0.5 to 4.5 m: log(1 + (e^1.2 - 1) 4.2^-4 + (e^0.5 - 1) (2.1 / 4.5)^4)
      {"noise_law", {1.2, 0.5, 4.0}, {.range_log_variance = 0.0375107181}},
      {"reciprocal_noise", {0.02}, {.range = 0.0037044}},  // cv = 0.02 * 2.1 = 0.042: 0.001764 * 2.1
      // n = (0, 1), t = (-1, 0): x = hypot(2.01, 0.02) - 2 = 0.0100994999; atan(-0.02 / 2.13)
      {"moved_landmark", {0.02, 0.01, 1.0, 2.0}, {.range = 0.0090946500, .bearing = -0.0093893954}},
      {"moved_landmark", {0.02, 0.01, 1.0, 4.0}, {}},  // before the move
      {"moved_landmark", {0.02, 0.01, 0.0, 2.0}, {}},
      // what these do lies elsewhere: in stops, dependence, tails, labels
      {"label_swap", {0.0, 1.0, 3.0, 3.0}, {}},
      {"heavy_tails", {0.03, 5.0}, {}},
      {"early_echo", {0.05, 0.4}, {}},
      {"late_return", {0.05, 0.4}, {}},
      {"cell_effect", {0.005}, {}},
      {"autocorrelated_noise", {0.6, 0.3, 1.0}, {}},
      {"bearing_quantisation", {0.0175}, {}},
      {"odometry_scale", {0.01}, {}},
      {"path_curvature", {0.02, 0.35}, {}},
      {"heading_drift", {0.02}, {}},
      {"odometry_random_walk", {0.01}, {}},
      {"lever_arm", {0.02, 0.01}, {}},
      {"turn_scale", {0.03}, {}},
      {"scan_latency", {0.2}, {}},
      {"wheel_slip", {0.05, 2.0}, {}},
      {"stated_sigma", {0.7}, {}},
      {"stop_effect", {0.02, 0.005}, {}},
  };
}

TEST(EffectValues, ReadingsAgreeWithHandWorkedOnes) {
  const EffectContext context = example_context();
  const ReadingView<double> at = example_reading(context);
  constexpr double tolerance = 1e-10;  // the values above are written with ten digits
  for (const Case& one : cases()) {
    SCOPED_TRACE(one.id);
    const Effect* effect = find_effect(one.id);
    ASSERT_NE(effect, nullptr);
    ASSERT_EQ(effect->info().parameters.size(), one.p.size());
    const ReadingChange<double> change = effect->reading(at, one.p.data());
    EXPECT_NEAR(change.range, one.expected.range, tolerance);
    EXPECT_NEAR(change.bearing, one.expected.bearing, tolerance);
    EXPECT_NEAR(change.range_log_variance, one.expected.range_log_variance, tolerance);
    EXPECT_NEAR(change.bearing_log_variance, one.expected.bearing_log_variance, tolerance);
  }
}

TEST(EffectValues, TiltIsWhatAPlaneSeesOfPlumbLines) {
  // The plane turned by tau about the axis at b0 meets the plumb line through D (cos b, sin b) at e_1, e_2 coordinates that are
  // distance and direction as the tilted sensor has them.
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  at.slope = 1.0, at.curvature = 0.0;
  const Effect* effect = find_effect("tilt");
  for (const double tau : {0.02, 0.25, 0.6})
    for (const double b0 : {-1.2, 0.3})
      for (int i = 0; i < 12; ++i) {
        at.bearing = -3.0 + 0.5 * i;
        const Eigen::AngleAxisd tilt(tau, Eigen::Vector3d(std::cos(b0), std::sin(b0), 0.0));
        const Eigen::Vector3d e1 = tilt * Eigen::Vector3d::UnitX(), e2 = tilt * Eigen::Vector3d::UnitY();
        const Eigen::Vector3d normal = e1.cross(e2);
        Eigen::Vector3d met(at.d * std::cos(at.bearing), at.d * std::sin(at.bearing), 0.0);
        met.z() = -(normal.x() * met.x() + normal.y() * met.y()) / normal.z();
        // A turn about b0 leaves directions from b0 as they are in the plane.
        const double seen = std::atan2(e2.dot(met), e1.dot(met));
        const double p[] = {tau * tau * std::cos(2.0 * b0), tau * tau * std::sin(2.0 * b0)};
        const ReadingChange<double> change = effect->reading(at, p);
        EXPECT_NEAR(change.range, met.norm() - at.d, 1e-12);
        EXPECT_NEAR(std::remainder(at.bearing + change.bearing - seen, 2.0 * pi), 0.0, 1e-12);
      }
  const double none[] = {0.0, 0.0};
  EXPECT_EQ(effect->reading(at, none).range, 0.0);
}

TEST(EffectValues, AMovedLandmarkIsSeenWhereItStands) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  at.slope = 1.0, at.curvature = 0.0, at.f = at.d, at.spread_power = 2;
  const double p[] = {0.3, -0.2, 1.0, 2.0};
  const double direction = at.bearing + at.heading;
  const Eigen::Vector2d there(at.axis_distance * std::cos(direction) + 0.3,
                              at.axis_distance * std::sin(direction) - 0.2);
  const ReadingChange<double> change = find_effect("moved_landmark")->reading(at, p);
  // The radius is left out of the second order of the range: 0.36^2 / 2 / 2 m * 6 % = 2 mm at most.
  EXPECT_NEAR(change.range, there.norm() - at.axis_distance, 2e-3);
  EXPECT_NEAR(change.bearing, std::atan2(there.y(), there.x()) - direction, 1e-12);
  at.radius = 0.0, at.axis_distance = at.d;
  const Eigen::Vector2d point(at.d * std::cos(direction) + 0.3, at.d * std::sin(direction) - 0.2);
  EXPECT_NEAR(find_effect("moved_landmark")->reading(at, p).range, point.norm() - at.d, 1e-12);
  EXPECT_NEAR(change.range_log_variance, 4.0 * std::log((at.d + change.range) / at.d), 1e-12);
}

TEST(EffectValues, AxialDepthTakesTheSpreadAlong) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  at.spread_power = 2;
  const double p[] = {0.1, 0.0};  // the reading changes by -0.0895 of 2.1
  EXPECT_NEAR(find_effect("axial_depth")->reading(at, p).range_log_variance,
              4.0 * std::log(1.0 - 0.0895 / 2.1), 1e-12);
  at.f = 0.0;
  EXPECT_EQ(at.spread_along(-0.1), 0.0);
  at.f = 2.1;
  EXPECT_NEAR(at.spread_along(-3.0), 4.0 * std::log(0.1), 1e-12);
}

TEST(EffectValues, EveryEffectHasAHandWorkedValue) {
  const std::vector<Case> all = cases();
  for (const Effect* effect : effects_testing::example_effects())
    EXPECT_TRUE(std::any_of(all.begin(), all.end(), [&](const Case& one) {
      return one.id == effect->info().id;
    })) << effect->info().id;
}

TEST(EffectValues, SectorOfAmbientLightCrossesTheSeam) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  at.bearing = pi - 0.1;
  const double p[] = {1.2, 0.0, -pi + 0.1, 0.25};  // 0.2 rad apart across the seam
  EXPECT_EQ(find_effect("ambient_light")->reading(at, p).range_log_variance, 1.2);
}

TEST(EffectValues, SettlingCountsRepeatsWhereThereAreNoTimes) {
  EffectContext context = example_context();
  context.stop_time_s.clear();
  context.duration_s = 0.0;
  const ReadingView<double> at = example_reading(context);
  const double p[] = {0.02, 2.0 / std::numbers::ln2};  // repeat 2: half of it is left
  EXPECT_NEAR(find_effect("settling")->reading(at, p).bearing, -0.01, 1e-15);
  EXPECT_EQ(find_effect("settling")->reported(context, p)[1].first, "time_repeats");
}

TEST(EffectValues, SettlingIsOverWhenTheStopIs) {
  EffectContext context = example_context();
  const Effect& settling = *find_effect("settling");
  context.stay_s = 3.0;
  EXPECT_EQ(settling.bounds(context, 1).second, 3.0);
  EXPECT_EQ(settling.bounds(context, 0).second, settling.info().parameters[0].high);
  EXPECT_NEAR(settling.start_grid(context).back()[1], 3.0, 1e-12);
  context.stay_s = 0.005;  // three readings at 500 Hz
  EXPECT_LT(settling.bounds(context, 1).first, settling.start_grid(context).front()[1] + 1e-15);
  EXPECT_EQ(settling.bounds(context, 1).second, 0.005);
  context.stay_s = 0.0;  // no times: in repeats
  context.largest_cell = 15.0;
  EXPECT_EQ(settling.bounds(context, 1).second, 14.0);
}

TEST(EffectValues, EmptyTemperatureChangesNothing) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  const double empty[] = {120.0, -74.0, std::numeric_limits<double>::quiet_NaN()};
  at.covariate = empty;
  const double p[] = {0.0015, 1.0};
  EXPECT_EQ(find_effect("range_scale")->reading(at, p).range, 0.0);
  const double of_kelvin[] = {0.001, 0.0, 25.0};
  EXPECT_EQ(find_effect("temperature_coefficient:temperature_c")->reading(at, of_kelvin).range, 0.0);
}

TEST(EffectValues, OffsetsAreOfDevicesOfKnownDistances) {
  EffectContext context = effects_testing::example_of_pairs();
  const Effect& offsets = *find_effect("device_offset");
  EXPECT_EQ(offsets.missing(context), "");
  EXPECT_NE(offsets.missing(example_context()), "");
  EXPECT_EQ(offsets.bounds(context, 1).second, 10.0);
  EXPECT_EQ(offsets.bounds(context, 2).second, 0.0) << "three devices have two differences";
  const double p[12] = {0.012, -0.03};
  const auto reported = offsets.reported(context, p);
  ASSERT_EQ(reported.size(), 2u);
  EXPECT_EQ(reported[1], (std::pair<std::string, double>{"offset_C_m", -0.03}));
  context.landmark_count = 14;
  EXPECT_NE(offsets.missing(context), "");
}

TEST(EffectValues, AntennaPatternIsOfDirectionsOrOfAColumn) {
  EffectContext context = effects_testing::example_of_pairs();
  context.largest_bearing_rad = 3.0;
  ReadingView<double> at = example_reading(context);  // b = 60 degrees
  const Effect &own = *find_effect("antenna_pattern"),
               &column = *find_effect("antenna_pattern:elevation_rad");
  // 0.01 cos b + 0.02 sin b + 0.03 cos 2 b + 0.04 cos 3 b = 0.005 + 0.01732050808 - 0.015 - 0.04
  const double p[10] = {0.01, 0.02, 0.03, 0.0, 0.04};
  EXPECT_NEAR(own.reading(at, p).range, -0.0326794919, 1e-10);
  EXPECT_EQ(own.missing(context), "");
  EXPECT_NE(own.missing(example_context()), "") << "the places of landmarks follow their directions";
  EXPECT_EQ(column.missing(example_context()), "");
  const std::vector<const Effect*> both = effects_of(context);
  EXPECT_EQ(std::count(both.begin(), both.end(), &own), 1);
  EXPECT_EQ(std::count(both.begin(), both.end(), &column), 1);
  const auto held = [&](const Effect& effect) {  // harmonics beyond what the directions tell apart
    int count = 0;
    for (std::size_t j = 0; j < 10; ++j) count += effect.bounds(context, j).second == 0.0 ? 1 : 0;
    return count / 2;
  };
  EXPECT_EQ(held(own), 0);
  context.largest_bearing_rad = 1.6;  // 183 degrees
  EXPECT_EQ(held(own), 2);
  EXPECT_EQ(own.reported(context, p).size(), 6u);
  for (const double narrow : {0.0, 1.5}) {
    context.largest_bearing_rad = narrow;
    EXPECT_NE(own.missing(context), "") << narrow;
  }
  // A column in degrees says the same as one in radians; an empty field nothing.
  const double angles[] = {60.0, std::numeric_limits<double>::quiet_NaN()};
  context.covariates = {"azimuth_deg", "elevation_rad"};
  at.covariate = angles;
  EXPECT_NEAR(find_effect("antenna_pattern:azimuth_deg")->reading(at, p).range, -0.0326794919, 1e-10);
  EXPECT_EQ(column.reading(at, p).range, 0.0);
}

TEST(EffectValues, AntennaPatternHoldsWhatALeverLeaves) {
  // Distances taken to the device's middle while its antenna sits q ahead of it: the true one is shorter by q cos b, to
  // q^2 / 2 D = 2.5e-5 m at 2 m.
  const EffectContext context = effects_testing::example_of_pairs();
  ReadingView<double> at = example_reading(context);
  const double q = 0.01, p[10] = {-q};
  for (const double b : {-2.0, 0.3, 1.4}) {
    at.bearing = b;
    const double shorter = std::hypot(2.0 * std::cos(b) - q, 2.0 * std::sin(b)) - 2.0;
    EXPECT_NEAR(find_effect("antenna_pattern")->reading(at, p).range, shorter, 2.6e-5);
  }
}

TEST(EffectValues, ScanLatencyReadsAnotherTrueDistance) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  at.rate_mps = -0.5;
  const double p[] = {0.2};  // x = -0.1: -0.09 + 0.05 * 0.01
  EXPECT_NEAR(find_effect("scan_latency")->reading(at, p).range, -0.0895, 1e-12);
}

TEST(EffectValues, RangeSaturationIsAParabolaOfShortSpans) {
  // A d / D - A d^2 / 2 D^2 up to A (d / D)^3 / 6: 0.4 / 6 * 0.1^3 = 6.7e-5 m at a tenth of D
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  const double p[] = {0.4, 15.0};
  for (const double d : {0.2, 0.8, 1.5}) {
    at.d = d;
    EXPECT_NEAR(find_effect("range_saturation")->reading(at, p).range, 0.4 * d / 15.0 - 0.2 * d * d / 225.0,
                6.7e-5);
  }
  // A receiver whose gain g closes on its limit with distance, dg/dd = (A - g) / D, in steps of a millimetre: each is off by
  // its square / 2 D^2 of what is left, 4e-5 of A in all.
  double gain = 0.0;
  for (int i = 0; i < 20000; ++i) gain += (0.4 - gain) / 15.0 * 0.001;
  at.d = 20.0;
  EXPECT_NEAR(find_effect("range_saturation")->reading(at, p).range, gain, 2e-5);
}

TEST(EffectValues, LevelAndSpreadOfAColumnAreReadOffTheRecordingOnce) {
  const EffectContext context = example_context();
  EXPECT_EQ(find_effect("temperature_coefficient:temperature_c")->start_grid(context)[0][2], 25.0);
  EXPECT_EQ(find_effect("power_bias:rx_power_dbm")->start_grid(context)[0][1], -70.0);
  const Eigen::VectorXd start = find_effect("covariate_drift:intensity")->start_grid(context)[0];
  EXPECT_EQ(start[3], 100.0);
  EXPECT_EQ(start[4], 10.0);
}

TEST(EffectValues, TruncationFarBeyondTheLimitLeavesTheLimit) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  for (double z :
       {-19.9, -20.1, -60.0}) {  // both branches: mean of the truncated normal, c + s / z to 1 / z^2
    const double p[] = {at.f + z * at.spread};
    const ReadingChange<double> change = find_effect("dropout")->reading(at, p);
    EXPECT_NEAR(at.f + change.range, p[0] + at.spread / z, 2.1 * at.spread / std::pow(-z, 3));
    EXPECT_NEAR(change.range_log_variance, -2.0 * std::log(-z), 6.5 / (z * z));
  }
}

TEST(EffectValues, DependenceAndTails) {
  const double step[] = {0.0175}, sigma[] = {0.005}, rho[] = {0.6, 0.3, 0.8}, outliers[] = {0.03, 5.0},
               edge[] = {0.002, 0.01};
  EXPECT_NEAR(find_effect("bearing_quantisation")->dependence(step).bearing_cell_sigma_rad, 0.0050518149,
              1e-10);
  EXPECT_EQ(find_effect("bearing_quantisation")->grid_steps({}, step).bearing_rad, step[0]);
  EXPECT_EQ(find_effect("cell_effect")->dependence(sigma).range_cell_sigma_m, 0.005);
  EXPECT_EQ(find_effect("autocorrelated_noise")->dependence(rho).range_correlation, 0.6);
  EXPECT_EQ(find_effect("autocorrelated_noise")->dependence(rho).bearing_correlation, 0.3);
  EXPECT_EQ(find_effect("autocorrelated_noise")->dependence(rho).range_correlated_share, 0.8);
  ReadingView<double> at{};
  at.spread = 0.01;
  // Five times the spread is the spread and sqrt(5^2 - 1) = 4.8989795 of it, independent of each other.
  EXPECT_EQ(find_effect("heavy_tails")->contamination(at, outliers).share, 0.03);
  EXPECT_NEAR(find_effect("heavy_tails")->contamination(at, outliers).extra_sigma_m, 0.048989795, 1e-9);
  at.d = 2.0;
  at.radius = 0.1;
  // share 0.002 / 0.1, error 0.01 * 2 m
  EXPECT_NEAR(find_effect("mixed_pixels")->contamination(at, edge).share, 0.02, 1e-15);
  EXPECT_NEAR(find_effect("mixed_pixels")->contamination(at, edge).extra_sigma_m, 0.02, 1e-15);
  EXPECT_EQ(find_effect("tilt")->contamination(at, edge).share, 0.0);
  EXPECT_EQ(find_effect("near_regime")->switching_distance(std::vector{0.01, 0.0, 1.5}.data()), 1.5);
  EXPECT_TRUE(std::isnan(find_effect("tilt")->switching_distance(edge)));
}

TEST(EffectValues, AmplitudesAndPhasesAreReported) {
  using ::testing::DoubleNear;
  using ::testing::ElementsAre;
  using ::testing::Pair;
  const EffectContext context = example_context();
  const double tilt[] = {0.0, 0.0025};  // tau = 0.05, 2 b0 = 90 degrees
  EXPECT_THAT(
      find_effect("tilt")->reported(context, tilt),
      ElementsAre(Pair("angle_rad", DoubleNear(0.05, 1e-12)), Pair("axis_rad", DoubleNear(pi / 4, 1e-12))));
  const double moved[] = {0.03, 0.04, 1.0, 3.0};
  EXPECT_THAT(find_effect("moved_landmark")->reported(context, moved),
              ElementsAre(Pair("landmark", 1.0), Pair("from_stop", 3.0), Pair("x_m", 0.03), Pair("y_m", 0.04),
                          Pair("distance_m", DoubleNear(0.05, 1e-12)), Pair("from_time_s", 98.0)));
  // A sin(b - psi) with A = 0.005: sine A cos psi, cosine -A sin psi, psi = 30 degrees
  const double encoder[] = {0.005 * 0.8660254037844386, -0.0025};
  const auto values = find_effect("encoder_eccentricity")->reported(context, encoder);
  EXPECT_NEAR(values[0].second, 0.005, 1e-12);
  EXPECT_NEAR(values[1].second, pi / 6, 1e-12);
}

TEST(EffectValues, PhasesOfWobblesAreThoseOfTheirFormulas) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  // delta r = A sin(k d + psi)
  const double cyclic[] = {0.003, -0.004, 7.0}, locking[] = {3e-6, -4e-6, 700.0};
  const auto of_distance = find_effect("cyclic_error")->reported(context, cyclic);
  EXPECT_EQ(of_distance[1].first, "phase_rad");
  // delta r = -A d^2 sin(k / d + psi)
  const auto of_disparity = find_effect("pixel_locking")->reported(context, locking);
  EXPECT_EQ(of_disparity[1].first, "phase_rad");
  for (const double d : {0.3, 1.1, 2.7}) {
    at.d = d;
    EXPECT_NEAR(find_effect("cyclic_error")->reading(at, cyclic).range,
                of_distance[0].second * std::sin(7.0 * d + of_distance[1].second), 1e-15);
    EXPECT_NEAR(find_effect("pixel_locking")->reading(at, locking).range,
                -of_disparity[0].second * d * d * std::sin(700.0 / d + of_disparity[1].second), 1e-12);
  }
}

// The centroid of a normal spot summed over whole pixels, by its sum: pixel n gets Phi((n + 1/2 - x) / w) - Phi((n - 1/2 - x) / w).
// x is the spot's place, w its width [px]; pixels count from far to near.
TEST(EffectValues, PixelLockingIsTheCentroidOfWholePixels) {
  const EffectContext context = example_context();
  ReadingView<double> at = example_reading(context);
  const auto below = [](double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); };
  const double pixels_m = 120.0;  // f s / p: a spot at d lies at 120 m / d
  // Width, and what the terms after the fifth leave out [px].
  for (const auto& [w, left_out] : {std::pair{0.4, 1e-12}, {0.2422, 1e-12}, {0.1534, 1e-8}, {0.1106, 1e-5}}) {
    const double amplitude_px = std::exp(-2.0 * pi * pi * w * w) / pi;
    // A pull by +1 px makes the reading shorter by d^2 / 120 m; psi = pi, for at a pixel's centre the pull falls with x.
    const double locking[] = {0.0, amplitude_px / pixels_m, 2.0 * pi * pixels_m};
    for (const double d : {0.4, 1.234, 2.9, 3.7}) {
      at.d = d;
      const double x = pixels_m / d;
      double centroid = 0.0;
      for (int n = static_cast<int>(x) - 8; n < x + 9; ++n)
        centroid += n * (below((n + 0.5 - x) / w) - below((n - 0.5 - x) / w));
      EXPECT_NEAR(find_effect("pixel_locking")->reading(at, locking).range,
                  -d * d / pixels_m * (centroid - x), d * d / pixels_m * left_out)
          << w << " px, " << d << " m";
    }
  }
}

TEST(EffectValues, AWobbleIsOfTheWayThatEarlierStagesLeave) {
  // A cover adds 3 mm to the way of 0.6 m; crosstalk of the wavelength 0.603 m, at its crest, 2 mm; the spot then stands for
  // 0.605 m, 200 pixels' periods.
  ReadingView<double> at;
  at.d = 0.6, at.bearing = 0.0;
  const std::vector<std::pair<const char*, std::vector<double>>> effects{
      {"range_eccentricity", {0.003, 0.0}},
      {"cyclic_error", {0.002, 0.0, 2.0 * pi / 0.603}},
      {"pixel_locking", {1e-5, 0.0, 200.0 * 2.0 * pi * 0.605}}};
  ReadingChain chain;
  for (const auto& [id, p] : effects) chain.add(*find_effect(id), p.data(), at);
  EXPECT_NEAR(chain.sum().range, 0.003 + 0.002 + 1e-5 * 0.605 * 0.605, 1e-11);
}

TEST(EffectValues, GridsRoundAndOthersDoNot) {
  const GridReading before{.range_m = 2.13, .bearing_rad = 0.1234};
  // 1 / 2.13 = 0.46948 is 9.39 steps of 0.05: 1 / 0.45 = 2.2222; that is 22.2 steps of 0.1
  const double disparity[] = {0.05, 0.0}, output[] = {0.0, 0.1}, both[] = {0.05, 0.1}, beam[] = {0.01};
  const Effect &quantisation = *find_effect("quantisation"), &beams = *find_effect("bearing_quantisation");
  EXPECT_NEAR(quantisation.rounded(before, disparity).range_m, 1.0 / 0.45, 1e-12);
  EXPECT_NEAR(quantisation.rounded(before, output).range_m, 2.1, 1e-12);
  EXPECT_NEAR(quantisation.rounded(before, both).range_m, 2.2, 1e-12);
  EXPECT_EQ(quantisation.rounded(before, both).bearing_rad, before.bearing_rad);
  EXPECT_NEAR(beams.rounded(before, beam).bearing_rad, 0.12, 1e-12);
  EXPECT_EQ(beams.rounded(before, beam).range_m, before.range_m);
  // Beyond 2 / q = 40 m the spot has moved by less than half a step from where it is at infinity.
  EXPECT_TRUE(std::isinf(quantisation.rounded({.range_m = 41.0}, disparity).range_m));
  EXPECT_NEAR(quantisation.rounded({.range_m = 39.0}, disparity).range_m, 20.0, 1e-12);
  for (const Effect* effect : effects_testing::example_effects()) {
    const Eigen::VectorXd p = effect->start_grid(example_context()).front();
    const GridReading after = effect->rounded(before, p.data());
    const bool stays = after.range_m == before.range_m && after.bearing_rad == before.bearing_rad;
    EXPECT_EQ(stays, effect->info().kind != EffectKind::grid) << effect->info().id;
  }
}

}  // namespace
}  // namespace rangecal
