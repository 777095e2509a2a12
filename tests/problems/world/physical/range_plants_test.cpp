// SPDX-License-Identifier: BSD-3-Clause
// Each departure of the range sensor against the linearised formula of the catalogue. The tolerance is the
// share of the formula's RMS that higher orders of the true geometry may take.
#include <gtest/gtest.h>

#include <numbers>

#include "problems/world/physical/compare.hpp"
#include "rangecal/problems/world/physical/optical_sensor.hpp"

namespace rangecal::world::test {
namespace {

void expect_bearing_kept(const Change& change) { EXPECT_LT(rms(change.bearing_rad), 1e-9); }

TEST(RangePlants, OffsetScaleAndPointing) {
  const Change offset = change_of(line(), "range_offset", 0.005);
  EXPECT_LT(misfit(offset.range_m, [&](std::size_t) { return 0.005; }), 1e-9);
  const Change scale = change_of(line(), "range_scale", 0.0015);
  EXPECT_LT(misfit(scale.range_m, [&](std::size_t i) { return 0.0015 * scale.distance_m[i]; }), 1e-6);
  const Change pointing = change_of(line(), "laser_pointing", 1e-4);
  EXPECT_LT(misfit(pointing.range_m,
                   [&](std::size_t i) { return std::pow(pointing.distance_m[i], 2) * 1e-4 / 0.05; }),
            0.02);
  expect_bearing_kept(pointing);
}

TEST(RangePlants, ArcDefinitionIsKappaTimesRadius) {
  const Change change = change_of(turning(), "arc_definition", 0.2);
  EXPECT_LT(
      misfit(change.range_m,
             [&](std::size_t i) {
               return 0.2 *
                      change.planted.landmarks[static_cast<std::size_t>(change.before.landmark[i])].radius_m;
             }),
      0.1);
  // All hits, D = 0.5 m, R = 0.12 m: 0.176 R nearer than far away, where it is 0.215 R.
  World one = plain(make_line_design());
  one.landmarks.resize(1);
  one.landmarks[0].x_m = 0.5, one.landmarks[0].y_m = 0.0;
  one.robot.stops.resize(1);
  EXPECT_NEAR(change_of(one, "arc_definition", 0.2146).range_m[0] / 0.12, 0.176, 0.002);
  one.landmarks[0].x_m = 5.0;
  EXPECT_NEAR(change_of(one, "arc_definition", 0.2146).range_m[0] / 0.12, 0.2146, 0.005);
}

TEST(RangePlants, RadiiAreLarger) {
  const Change all = change_of(turning(), "radius_scale", 0.05);
  EXPECT_LT(
      misfit(
          all.range_m,
          [&](std::size_t i) {
            return -0.05 *
                   all.planted.landmarks[static_cast<std::size_t>(all.before.landmark[i])].nominal_radius_m;
          }),
      1e-6);
  const Change one = change_of(turning(), "landmark_radius", 0.005);
  EXPECT_LT(misfit(one.range_m,
                   [&](std::size_t i) {
                     return one.before.landmark[i] == one.truth("landmark_radius.landmark") ? -0.005 : 0.0;
                   }),
            1e-6);
}

TEST(RangePlants, LensDistortionGoesWithOneOverDistance) {
  const Change change = change_of(line(), "lens_distortion", 7.7e-4);
  EXPECT_NEAR(change.truth("lens_distortion.inverse_m2"), -7.7e-4 * 720 * 720 * 1e-6, 1e-12);
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     return change.truth("lens_distortion.inverse_m2") / change.distance_m[i];
                   }),
            0.02);
}

TEST(RangePlants, PixelSumsPullTheCentroid) {
  // Pull towards the pixel's centre, so d r = + d^2 A sin(2 pi x / p) with x / p = (fs / p) / d.
  const Change change = change_of(line(), "pixel_locking", 0.1);
  const double amplitude = change.truth("pixel_locking.amplitude_per_m"),
               cycle = change.truth("pixel_locking.period_per_m");
  EXPECT_NEAR(amplitude * 9.0, 7.5e-3, 1e-6);  // 0.1 px is 7.5 mm at 3 m
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     const double d = change.distance_m[i];
                     return d * d * amplitude * std::sin(2.0 * std::numbers::pi / (cycle * d));
                   }),
            0.1);
  EXPECT_NEAR(pixel_centroid_px(10.25, 0.5), 10.25, 0.01);  // a wide spot is found where it is
  EXPECT_LT(pixel_centroid_px(10.25, 0.2), 10.16);
}

TEST(RangePlants, QuantisedCentroidSitsOnALatticeOfDisparity) {
  Random random(1);
  const World world = apply(line(), "quantisation", 0.1, random);
  const Recording recording = simulate(world, 1);
  const double step = world.truth.at("quantisation.disparity_step_per_m");
  for (const double range : recording.readings.range_m) {
    const double steps = 1.0 / range / step;
    EXPECT_NEAR(steps, std::round(steps), 1e-6);
  }
  const Expected out = expected(world);
  EXPECT_DOUBLE_EQ(out.disparity_step_per_m, step);
  EXPECT_LT(std::abs(out.range_mean_m[0] - expected(line()).range_mean_m[0]), 1e-4);
}

TEST(RangePlants, NearTableActsBelowItsLimitOnly) {
  const Change change = change_of(line(), "near_regime", 0.005);
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     return change.distance_m[i] < change.truth("near_regime.limit_m") ? 0.005 : 0.0;
                   }),
            1e-9);
}

TEST(RangePlants, OneSurfaceReadsLong) {
  std::vector<bool> seen(2, false);
  for (std::uint64_t seed = 0; seed < 8; ++seed) {
    const Change change = change_of(line(), "target_reflectance", 0.015, seed);
    const double power = change.truth("target_reflectance.power"),
                 size = change.truth("target_reflectance.amplitude_m");
    seen[power > 0.0] = true;
    EXPECT_LT(misfit(change.range_m,
                     [&](std::size_t i) {
                       return change.before.landmark[i] == change.truth("target_reflectance.landmark")
                                  ? size * std::pow(change.distance_m[i], power)
                                  : 0.0;
                     }),
              0.05);
  }
  EXPECT_TRUE(seen[0] && seen[1]);
}

TEST(RangePlants, TiltStretchesThePlane) {
  // dr = tau^2/2 D sin^2(b - b0), db = tau^2/4 sin 2(b - b0): D is the distance to the axis.
  const Change change = change_of(turning(), "tilt", 0.0873);
  const double tau_sq = 0.0873 * 0.0873, axis = change.truth("tilt.axis_rad");
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     return 0.5 * tau_sq * change.distance_m[i] *
                            std::pow(std::sin(change.beam_rad[i] - axis), 2);
                   }),
            0.1);
  EXPECT_LT(
      misfit(change.bearing_rad,
             [&](std::size_t i) { return 0.25 * tau_sq * std::sin(2.0 * (change.beam_rad[i] - axis)); }),
      0.05);
}

TEST(RangePlants, LeanUnderTiltMovesTheAxis) {
  // lean = tilt = 2 degrees at 4 m: 4 m * sin 2 deg * tan 2 deg = 4.9 mm towards or away.
  World world = plain(make_line_design());
  world.landmarks.resize(1), world.robot.stops.resize(1);
  world.landmarks[0].x_m = 4.0, world.landmarks[0].y_m = 0.0;
  world.head.tilt_rad = 2.0 * std::numbers::pi / 180.0, world.head.tilt_axis_rad = std::numbers::pi / 2;
  const double upright = expected(world).range_mean_m[0];
  world.landmarks[0].lean_rad = 2.0 * std::numbers::pi / 180.0;
  EXPECT_NEAR(std::abs(expected(world).range_mean_m[0] - upright), 4.9e-3, 0.3e-3);
}

TEST(RangePlants, WarmUp) {
  const Change change = change_of(line(), "warmup_drift", 0.01);
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     const double d = change.distance_m[i];
                     return (change.truth("warmup_drift.offset_m") +
                             change.truth("warmup_drift.curvature_per_m") * d * d) *
                            (1.0 - std::exp(-change.time_s[i] / change.truth("warmup_drift.time_s")));
                   }),
            0.05);
}

TEST(RangePlants, EccentricRing) {
  const Change change = change_of(turning(), "range_eccentricity", 0.0075);
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     return change.truth("range_eccentricity.cos_m") * std::cos(change.beam_rad[i]) +
                            change.truth("range_eccentricity.sin_m") * std::sin(change.beam_rad[i]);
                   }),
            0.05);
  expect_bearing_kept(change);
}

TEST(RangePlants, OutOfRoundAgainstItsAzimuth) {
  // The surface stands out by eta R cos 2(azimuth - psi) towards the sensor: the range is shorter by that.
  const Change change = change_of(turning(), "landmark_shape", 0.05);
  const std::size_t l = static_cast<std::size_t>(change.truth("landmark_shape.landmark"));
  const Cylinder& odd = change.planted.landmarks[l];
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     if (change.before.landmark[i] != static_cast<int>(l)) return 0.0;
                     const Pose2& stop = change.before.stops[static_cast<std::size_t>(change.before.stop[i])];
                     const double azimuth = std::atan2(odd.y_m - stop.y_m, odd.x_m - stop.x_m);
                     return -0.05 * odd.radius_m *
                            std::cos(2.0 * (azimuth - change.truth("landmark_shape.axis_rad")));
                   }),
            0.2);
}

TEST(RangePlants, LeakingPhasor) {
  const Change change = change_of(line(), "cyclic_error", 0.005);
  const double length = change.truth("cyclic_error.wavelength_m"),
               phase = change.planted.sensor.crosstalk_phase_rad;
  EXPECT_LT(misfit(change.range_m,
                   [&](std::size_t i) {
                     return 0.005 * std::sin(phase - 2.0 * std::numbers::pi * change.distance_m[i] / length);
                   }),
            0.15);
}

}  // namespace
}  // namespace rangecal::world::test
