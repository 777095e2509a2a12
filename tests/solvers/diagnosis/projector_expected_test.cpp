// SPDX-License-Identifier: BSD-3-Clause
// Scores have expectation zero on clean recordings: against derivatives of the log determinant taken
// numerically, and on recordings of so many stops that the second order matters.
#include <gtest/gtest.h>

#include <Eigen/Cholesky>
#include <cmath>
#include <numbers>
#include <string>
#include <vector>

#include "diagnosis/working.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/add_reading.hpp"
#include "support/paper_scene.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double sigma_theta = 0.05, sigma_e = 0.03, sigma_xy = 0.05, sigma_heading = 0.04;

/// Four stops and four landmarks, every reading exact.
struct Scene {
  Recording recording;
  Rows rows;
  JointState truth;

  Scene() {
    const std::vector<Eigen::Vector2d> axes{{0.5, 0.4}, {1.1, -0.5}, {-0.3, 0.7}, {0.6, -0.6}};
    recording.kind = RecordingKind::landmarks;
    recording.path = "made";
    testing::add_landmarks(recording, axes.size());
    truth.alpha = Eigen::Vector3d(0.02, 1.03, 0.01);
    for (int k = 0; k < 4; ++k) {
      const Pose2 pose{0.25 * k, 0.05 * k * k, 0.3 * k - 0.4};
      testing::add_stop(recording, pose, sigma_xy, sigma_heading);
      truth.stops.push_back(pose);
      for (std::size_t l = 0; l < axes.size(); ++l) {
        const Eigen::Vector2d v = axes[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
        const double d = v.norm();
        testing::add_reading(recording, k, static_cast<int>(l), 0, 0.02 + 1.03 * d + 0.01 * d * d,
                             wrap_angle(std::atan2(v.y(), v.x()) - pose.heading_rad));
      }
    }
    truth.landmarks = axes;
    truth.noise.law = NoiseLaw::constant;
    truth.noise.parameters = Eigen::VectorXd::Constant(1, sigma_e);
    truth.sigma_theta_rad = sigma_theta;
    rows = make_rows({&recording, 1});
  }

  /// Unknowns: stops (x, y, h) each, then alpha, landmarks, and the size of the effect.
  static constexpr int stops = 12, globals = 3 + 8 + 1;
  /// The joint NLL without constants, of an effect with its first parameter at the last unknown.
  double value(const Eigen::VectorXd& u, ActiveEffect active) const {
    JointState state = truth;
    double sum = 0.0;
    for (int k = 0; k < 4; ++k) {
      Pose2& pose = state.stops[k];
      pose = {u[3 * k], u[3 * k + 1], u[3 * k + 2]};
      const Pose2& meant = recording.stops[k].commanded;
      sum += 0.5 * (std::pow(pose.x_m - meant.x_m, 2) + std::pow(pose.y_m - meant.y_m, 2)) /
                 (sigma_xy * sigma_xy) +
             0.5 * std::pow((pose.heading_rad - meant.heading_rad) / sigma_heading, 2);
    }
    state.alpha = u.segment<3>(stops);
    for (int l = 0; l < 4; ++l) state.landmarks[l] = u.segment<2>(stops + 3 + 2 * l);
    active.parameters[0] = u[stops + globals - 1];
    const CellGeometry g = cell_geometry(rows, state);
    for (int c = 0; c < rows.cell_count; ++c) {
      const auto change =
          active.effect->reading(view_of(rows, g, static_cast<std::size_t>(c)), active.parameters.data());
      const double range = rows.range_m[c] - g.f[c] - change.range;
      const double bearing = wrap_angle(rows.bearing_rad[c] - g.bearing[c] - change.bearing);
      sum += 0.5 * std::pow(range / sigma_e, 2) + 0.5 * std::pow(bearing / sigma_theta, 2);
    }
    return sum;
  }
  Eigen::VectorXd true_unknowns(double size) const {
    Eigen::VectorXd u(stops + globals);
    for (int k = 0; k < 4; ++k)
      u.segment<3>(3 * k) << truth.stops[k].x_m, truth.stops[k].y_m, truth.stops[k].heading_rad;
    u.segment<3>(stops) = truth.alpha;
    for (int l = 0; l < 4; ++l) u.segment<2>(stops + 3 + 2 * l) = truth.landmarks[l];
    u[stops + globals - 1] = size;
    return u;
  }
  /// Second derivatives over the first n unknowns, by central differences.
  Eigen::MatrixXd hessian(const Eigen::VectorXd& u, int n, const ActiveEffect& active) const {
    constexpr double h = 2e-4;
    Eigen::MatrixXd H(n, n);
    for (int i = 0; i < n; ++i)
      for (int j = 0; j <= i; ++j) {
        const auto at = [&](double a, double b) {
          Eigen::VectorXd v = u;
          v[i] += a * h;
          v[j] += b * h;
          return value(v, active);
        };
        H(i, j) = H(j, i) = (at(1, 1) - at(1, -1) - at(-1, 1) + at(-1, -1)) / (4.0 * h * h);
      }
    return H;
  }
  /// ln det H / 2 over the stops at their optimum for these globals.
  double half_log_det(Eigen::VectorXd u, const ActiveEffect& active) const {
    Eigen::MatrixXd H;
    for (int step = 0; step < 4; ++step) {
      H = hessian(u, stops, active);
      Eigen::VectorXd gradient(stops);
      for (int i = 0; i < stops; ++i) {
        Eigen::VectorXd up = u, down = u;
        up[i] += 1e-5;
        down[i] -= 1e-5;
        gradient[i] = (value(up, active) - value(down, active)) / 2e-5;
      }
      u.head<stops>() -= H.llt().solve(gradient);
    }
    return hessian(u, stops, active).llt().matrixLLT().diagonal().array().log().sum();
  }
};

TEST(ExpectedScores, AreTheSlopeOfTheLogDeterminant) {
  const Scene scene;
  for (const char* id : {"range_eccentricity", "bearing_scale", "lens_distortion", "encoder_ellipticity"}) {
    const Effect* effect = find_effect(id);
    ASSERT_TRUE(effect) << id;
    ActiveEffect active{effect, effect->start_grid(scene.rows.context).front()};
    const Eigen::VectorXd u = scene.true_unknowns(0.0);
    active.parameters.setZero();
    constexpr int stops = Scene::stops, globals = Scene::globals;
    // By brute force: the slopes k of ln det H / 2 in alpha, the landmarks and the effect, and their
    // information A with the stops eliminated.
    Eigen::VectorXd k(globals);
    for (int j = 0; j < globals; ++j) {
      const double h = j == globals - 1 ? 0.1 * effect->info().parameters[0].typical : 1e-3;
      Eigen::VectorXd up = u, down = u;
      up[stops + j] += h;
      down[stops + j] -= h;
      k[j] = (scene.half_log_det(up, active) - scene.half_log_det(down, active)) / (2.0 * h);
    }
    const Eigen::MatrixXd H = scene.hessian(u, stops + globals, active);
    const Eigen::MatrixXd A =
        H.bottomRightCorner<globals, globals>() -
        H.bottomLeftCorner<globals, stops>() *
            H.topLeftCorner<stops, stops>().llt().solve(H.topRightCorner<stops, globals>());
    constexpr int phi = globals - 1;
    const double expected =
        k[phi] - A.row(phi).head<phi>().dot(A.topLeftCorner<phi, phi>().ldlt().solve(k.head<phi>()));
    // Readings without an error have residual 0: what the score of one says is what it takes off.
    const Projector projector(scene.rows, working_problem(scene.rows, {}, scene.truth), scene.truth);
    const Signature x = effect_signature(scene.rows, projector, active, 0);
    EXPECT_NEAR(-projector.score(x), expected, 2e-3 * std::abs(k[phi]) + 1e-4) << id;
    EXPECT_GT(std::abs(k[phi]), 1e-3) << id;
  }
}

/// 150 stops along two metres between six poles, three sweeps each; bearings too poor to hold the stops,
/// which are known to a centimetre.
Recording many_stops(std::uint64_t seed) {
  Recording recording;
  recording.kind = RecordingKind::landmarks;
  recording.path = "made";
  Random random(seed_from("ExpectedScores.many_stops", {seed}));
  const std::vector<Eigen::Vector2d> axes{{0.2, 0.45}, {0.7, -0.4}, {1.1, 0.6},
                                          {1.5, -0.5}, {1.9, 0.4},  {1.3, -0.9}};
  testing::add_landmarks(recording, axes.size());
  for (int k = 0; k < 150; ++k) {
    const Pose2 meant{2.0 * k / 149.0, 0.0, 0.0};
    testing::add_stop(recording, meant, 0.01, 0.0);
    const Eigen::Vector2d at(meant.x_m + random.normal(0.0, 0.01), random.normal(0.0, 0.01));
    for (int j = 0; j < 3; ++j)
      for (std::size_t l = 0; l < axes.size(); ++l) {
        const Eigen::Vector2d v = axes[l] - at;
        const double f = 0.02 + 1.01 * v.norm();
        testing::add_reading(recording, k, static_cast<int>(l), j, f + 0.02 * f * f * random.normal(),
                             wrap_angle(std::atan2(v.y(), v.x()) + random.normal(0.0, 0.05)));
      }
  }
  return recording;
}

TEST(ExpectedScores, OfHundredsOfStopsRaiseNoAlarm) {
  // To first order alone recordings like these alarm, each of them. At 2 % each, two of four do in one of 400
  // cases.
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  int alarms = 0;
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const std::vector<Recording> recordings{many_stops(seed)};
    alarms += diagnose(recordings, options).verdict != Verdict::no_mismatch;
  }
  EXPECT_LE(alarms, 1);
}

/// Twenty stops on a circle, turning as they go, five cylinders around, one reading each.
Recording circle(std::uint64_t seed) {
  rangecal::Scene scene = rangecal::testing::paper_scene();
  scene.alpha = Eigen::Vector3d(0.05, 0.9, 0.05);
  scene.noise.parameters[0] = 0.008;
  scene.sensor.range_min_m = 0.1;
  scene.sensor.range_max_m = 10.0;
  scene.sigma_xy_m = 0.01;
  const auto rounded = [](double x) { return std::round(1e4 * x) / 1e4; };
  for (int k = 0; k < 20; ++k) {
    const double t = 2.0 * std::numbers::pi * k / 20.0;
    rangecal::testing::add_stop(scene, {rounded(1.5 + 1.2 * std::cos(t)), rounded(1.2 * std::sin(t)),
                                        rounded(std::fmod(3.0 * t, 2.0 * std::numbers::pi))});
  }
  for (const auto& [x, y] : {std::pair{0.3, 2.1}, {2.6, 2.4}, {3.4, -1.9}, {-0.6, -1.8}, {1.4, -2.6}}) {
    scene.landmarks.push_back({std::string(1, static_cast<char>('A' + scene.landmarks.size())), 0.1, {}});
    scene.positions.emplace_back(x, y);
  }
  scene.repeats = 1;
  return simulate(scene, seed);
}

TEST(ExpectedScores, AreLeftAloneWhereAShapeTurnsOver) {
  // Seed 161 alarmed with p = 7e-73: near_regime below a limit that few cells reach, whose expectation was
  // dropped while that of the calibration's own scores, which nearly make it up, was not.
  const Recording recording = circle(161);
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  EXPECT_GT(diagnose(std::span(&recording, 1), options).alarm_p_value, 1e-3);
}

}  // namespace
}  // namespace rangecal::diagnosis
