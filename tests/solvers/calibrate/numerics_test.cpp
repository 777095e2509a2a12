// SPDX-License-Identifier: BSD-3-Clause
// An answer belongs to the readings: not to the unit of length, nor to where the frame begins, nor to the
// number of threads, nor to digits far below the noise.
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include <cmath>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "support/paper_scene.hpp"

namespace rangecal {
namespace {

/// K stops along a bent path among five landmarks of 5 cm, noise 0.01 f^2, bearings 0.5 degrees, stops 1 cm.
Scene scene_of(int stops, int repeats) {
  Scene scene = testing::paper_scene();
  for (int k = 0; k < stops; ++k)
    testing::add_stop(scene, {6.0 * k / stops, 0.3 * std::sin(12.0 * k / stops), 0.0});
  for (int l = 0; l < 5; ++l) {
    scene.landmarks.push_back({"T" + std::to_string(l), 0.05, {}});
    scene.positions.emplace_back(0.5 + 1.2 * l, (l % 2 ? -1.0 : 1.0) * (1.0 + 0.4 * l));
  }
  scene.tapes.push_back({0, 3, 0.005});
  scene.repeats = repeats;
  return scene;
}

/// The same recording with another unit of length, `length` of which are a metre, and another origin.
Recording rewritten(Recording r, double length, const Eigen::Vector2d& origin) {
  for (Stop& stop : r.stops) {
    stop.commanded.x_m = length * stop.commanded.x_m + origin.x();
    stop.commanded.y_m = length * stop.commanded.y_m + origin.y();
    if (stop.sigma_xy_m) *stop.sigma_xy_m *= length;
  }
  r.sigma_xy_m *= length;
  for (Landmark& landmark : r.landmarks) landmark.radius_m *= length;
  for (KnownDistance& taped : r.known_distances) {
    taped.distance_m *= length;
    taped.sigma_m *= length;
  }
  for (double& range : r.readings.range_m) range *= length;
  for (double& range : r.pairs.true_m) range *= length;
  for (double& range : r.pairs.reading_m) range *= length;
  r.sensor.range_min_m *= length;
  r.sensor.range_max_m *= length;
  return r;
}

int noise_power(const Noise& noise) { return noise.law == NoiseLaw::d_squared ? 2 : noise.power_of_f(); }

/// `there` is `here` in the other unit, within `part` of a standard deviation.
void expect_same(const Calibration& here, const Calibration& there, double length,
                 const Eigen::Vector2d& origin, double part, const std::string& what) {
  SCOPED_TRACE(what + ", " + to_string(here.method));
  ASSERT_EQ(here.outcome, Outcome::converged) << here.reason;
  ASSERT_EQ(there.outcome, Outcome::converged) << there.reason;
  ASSERT_EQ(here.order(), there.order());
  ASSERT_EQ(here.noise.law, there.noise.law);
  ASSERT_TRUE(here.alpha_covariance && there.alpha_covariance);
  for (int i = 0; i <= here.order(); ++i) {
    const double unit = std::pow(length, 1 - i), std_dev = std::sqrt((*here.alpha_covariance)(i, i));
    EXPECT_NEAR(there.alpha[i] / unit, here.alpha[i], part * std_dev) << "alpha_" << i;
    EXPECT_NEAR(std::sqrt((*there.alpha_covariance)(i, i)) / unit, std_dev, part * std_dev) << "alpha_" << i;
  }
  const double unit = std::pow(length, 1 - noise_power(here.noise));
  const auto near = [&](const Estimate& a, const Estimate& b, double factor, const char* name) {
    const double std_dev = a.std_dev.value_or(a.value);
    EXPECT_NEAR(b.value / factor, a.value, part * std_dev) << name;
    ASSERT_EQ(a.std_dev.has_value(), b.std_dev.has_value()) << name;
    if (a.std_dev) {
      EXPECT_NEAR(*b.std_dev / factor, std_dev, 10.0 * part * std_dev) << name;
    }
  };
  near(here.noise_estimates[0], there.noise_estimates[0], unit, "sigma_e");
  if (here.kind == RecordingKind::pairs) return;
  near(*here.sigma_theta_rad, *there.sigma_theta_rad, 1.0, "sigma_theta");
  ASSERT_EQ(here.sigma_s_m.has_value(), there.sigma_s_m.has_value());
  if (here.sigma_s_m) near(*here.sigma_s_m, *there.sigma_s_m, length, "sigma_s");
  for (std::size_t l = 0; l < here.landmarks.size(); ++l) {
    const double std_dev = std::sqrt(here.landmarks[l].covariance->trace());
    EXPECT_LT(((there.landmarks[l].position_m - origin) / length - here.landmarks[l].position_m).norm(),
              part * std_dev)
        << l;
  }
}

struct Rewriting {
  const char* name;
  double length;
  Eigen::Vector2d origin;
  double part;  ///< of a standard deviation that the answer may move
};
/// Solvers stop a millionth of a standard deviation short; positions of 1e6 m round to 1e-10 m, a millionth
/// of the smallest standard deviation here, and enter the curve's through differences.
const Rewriting rewritings[] = {{"micrometres", 1e6, {0.0, 0.0}, 1e-4},
                                {"thousands of kilometres", 1e-6, {0.0, 0.0}, 1e-4},
                                {"an origin 1e6 m away", 1.0, {1e6, -1e6}, 1e-3},
                                {"micrometres, 1e6 of them away", 1e6, {1e6, 1e6}, 1e-4}};

void expect_all_same(const Recording& recording, const CalibrateOptions& options, const std::string& what) {
  const std::vector<Calibration> here = calibrate({&recording, 1}, options);
  for (const Rewriting& to : rewritings) {
    if (recording.kind == RecordingKind::pairs && to.length == 1.0) continue;
    const Recording other = rewritten(recording, to.length, to.origin);
    const std::vector<Calibration> there = calibrate({&other, 1}, options);
    ASSERT_EQ(here.size(), there.size());
    for (std::size_t i = 0; i < here.size(); ++i)
      expect_same(here[i], there[i], to.length, to.origin, to.part, what + " in " + to.name);
  }
}

TEST(Units, AnotherUnitOfLengthOrOriginGivesTheSameAnswer) {
  const Recording recording = simulate(scene_of(15, 4), seed_from("units"));
  CalibrateOptions options;
  options.order = 2;
  for (NoiseLaw law :
       {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed, NoiseLaw::d_squared}) {
    options.noise = law;
    expect_all_same(recording, options, to_string(law));
  }
}

TEST(Units, OrderAndLawAreChosenAlike) {
  expect_all_same(simulate(scene_of(15, 4), seed_from("units chosen")), {}, "chosen");
}

TEST(Units, ASigmaOfTheStopsIsEstimatedAlike) {
  Scene scene = scene_of(25, 4);
  scene.sigma_xy_m = 0.04;
  Recording recording = simulate(scene, seed_from("units sigma_s"));
  recording.estimate_sigma_xy = true;
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::marginal};
  expect_all_same(recording, options, "sigma_s");
}

TEST(Units, ARandomWalkIsCalibratedAlike) {
  Scene scene = scene_of(15, 4);
  scene.stop_error = StopErrorModel::random_walk;
  scene.sigma_heading_rad = 0.01;
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::full, Method::marginal};
  expect_all_same(simulate(scene, seed_from("units walk")), options, "walk");
}

TEST(Units, PairsAreCalibratedAlike) {
  Scene scene = scene_of(1, 1);
  scene.kind = RecordingKind::pairs;
  for (int i = 0; i < 10; ++i) scene.batches.push_back({0.4 + 0.45 * i, 20});
  CalibrateOptions options;
  options.order = 2;
  for (NoiseLaw law :
       {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed, NoiseLaw::d_squared}) {
    options.noise = law;
    expect_all_same(simulate(scene, seed_from("units pairs")), options, to_string(law));
  }
}

TEST(Rounding, ThreeDecimalsDoNoHarm) {
  // A millimetre's grid adds a variance of 1 / 12 mm^2 to that of readings, 1.4 mm and more at 0.4 m; 1e-3
  // rad adds 1 / 12 of (1e-3 / 8.7e-3)^2: 0.1 %. Estimates move by about sqrt(0.04) of a standard deviation
  // at most.
  const Recording exact = simulate(scene_of(15, 4), seed_from("three decimals"));
  Recording rounded = exact;
  const auto to_three = [](double& value) { value = std::round(1e3 * value) / 1e3; };
  for (double& range : rounded.readings.range_m) to_three(range);
  for (double& bearing : rounded.readings.bearing_rad) to_three(bearing);
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  const std::vector<Calibration> here = calibrate({&exact, 1}, options),
                                 there = calibrate({&rounded, 1}, options);
  for (std::size_t i = 0; i < here.size(); ++i)
    expect_same(here[i], there[i], 1.0, {0.0, 0.0}, 0.3, "rounded");
}

TEST(Rounding, NoiseBelowTheLastDecimalIsNoTrouble) {
  // Noise of 20 um and 20 urad on a grid of 1 mm and 1 mrad: repeats are alike, and the grid is the noise,
  // 0.29 of a step.
  Scene scene = scene_of(15, 4);
  scene.noise = {NoiseLaw::constant, Eigen::VectorXd::Constant(1, 2e-5)};
  scene.sigma_theta_rad = 2e-5;
  Recording recording = simulate(scene, seed_from("below the grid"));
  for (double& range : recording.readings.range_m) range = std::round(1e3 * range) / 1e3;
  for (double& bearing : recording.readings.bearing_rad) bearing = std::round(1e3 * bearing) / 1e3;
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::constant;
  options.methods = {Method::full, Method::marginal};
  for (const Calibration& c : calibrate({&recording, 1}, options)) {
    ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
    EXPECT_NEAR(c.noise.parameters[0], 0.29e-3, 0.1e-3) << to_string(c.method);
    EXPECT_NEAR(c.sigma_theta_rad->value, 0.29e-3, 0.1e-3) << to_string(c.method);
    for (double d : {0.5, 2.0, 4.0})
      EXPECT_NEAR(c.alpha[0] + c.alpha[1] * d + c.alpha[2] * d * d, 0.0525 + 0.8838 * d + 0.0584 * d * d,
                  0.01)
          << d;
  }
}

/// JSON without the times that the solves took.
std::string answer_on(int threads, const Recording& recording, const CalibrateOptions& options) {
  const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                  static_cast<std::size_t>(threads));
  std::vector<Calibration> all = calibrate({&recording, 1}, options);
  for (Calibration& c : all) c.seconds = 0.0;
  return calibrations_to_json(all);
}

TEST(Threads, GiveTheSameBits) {
  const Recording recording =
      simulate(scene_of(2500, 1), seed_from("threads"));  // enough stops to be shared out
  CalibrateOptions options;
  options.order = 2;
  options.noise = NoiseLaw::f_squared;
  options.methods = {Method::closed_form, Method::full, Method::marginal};
  options.solver = JointSolver::block;
  const std::string one = answer_on(1, recording, options);
  for (int threads : {2, 3, 8}) EXPECT_EQ(answer_on(threads, recording, options), one) << threads;
  options.methods = {Method::full};
  options.solver = JointSolver::ceres;
  EXPECT_EQ(answer_on(4, recording, options), answer_on(1, recording, options));
}

TEST(Threads, GiveTheSameDiagnosis) {
  const Recording recording = simulate(scene_of(15, 4), seed_from("threads diagnose"));
  const auto on = [&](int threads) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism,
                                    static_cast<std::size_t>(threads));
    DiagnoseOptions options;
    options.null_draws = 100;
    options.next_experiments = false;
    return diagnosis_to_json(diagnose({&recording, 1}, options));
  };
  EXPECT_EQ(on(1), on(4));
}

}  // namespace
}  // namespace rangecal
