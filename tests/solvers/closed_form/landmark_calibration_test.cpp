// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"

#include <gtest/gtest.h>

#include <Eigen/Dense>
#include <boost/math/distributions/chi_squared.hpp>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "solvers/closed_form/scenes.hpp"

namespace rangecal {
namespace {

using closed_form_tests::BearingScene;
using closed_form_tests::problem_of;

using Estimator = Calibration (*)(const JointProblem&, const ClosedFormOptions&);
constexpr Estimator both[] = {closed_form_calibration, approximate_joint_calibration};

ClosedFormOptions of_order(int order) {
  ClosedFormOptions options;
  options.order = order;
  return options;
}

TEST(ClosedFormCalibration, ExactOnNoiseFreeData) {
  const BearingScene scene;
  for (const Estimator method : both) {
    for (const bool chosen : {false, true}) {
      const Calibration c = method(problem_of(scene), chosen ? ClosedFormOptions{} : of_order(2));
      ASSERT_EQ(c.outcome, Outcome::converged) << c.reason;
      ASSERT_EQ(c.order(), 2);
      EXPECT_LT((c.alpha - scene.alpha).cwiseAbs().maxCoeff(), 1e-10);
      for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
        EXPECT_LT((c.landmarks[l].position_m - scene.landmarks[l]).norm(), 1e-10);
    }
  }
}

TEST(ClosedFormCalibration, RecoversCurveAndNoise) {
  const int repeats = 60;
  for (const Estimator method : both) {
    double sigma_e = 0.0, sigma_theta = 0.0, worst = 0.0;
    for (std::uint64_t repeat = 0; repeat < repeats; ++repeat) {
      BearingScene scene{.stops = 40, .repeats = 4, .sigma_theta = 0.008, .sigma_s = 0.002, .sigma_e = 0.01};
      const Calibration c = method(problem_of(scene, seed_from("Recovers", {repeat})), of_order(2));
      ASSERT_TRUE(is_usable(c.outcome)) << c.reason;
      sigma_e += c.noise.parameters(0) / repeats;
      sigma_theta += c.sigma_theta_rad->value / repeats;
      for (const double d : {0.8, 2.0, 3.5})
        worst =
            std::max(worst, std::abs(evaluate_polynomial(c.alpha, d) - evaluate_polynomial(scene.alpha, d)));
    }
    EXPECT_NEAR(sigma_e, 0.01, 0.0003);  // 800 readings: 2.5 % each, 0.3 % the mean, and the model's 2 %
    EXPECT_NEAR(sigma_theta, 0.008, 0.00024);
    EXPECT_LT(worst, 0.05);
  }
}

TEST(ApproximateJointCalibration, ConvergesOnRandomScenesAndImprovesOnTheClosedForm) {
  const int scenes = 100;
  double closed = 0.0, approximate = 0.0;
  for (std::uint64_t number = 0; number < scenes; ++number) {
    Random random(seed_from("ApproximateJoint.Scenes", {number}));
    BearingScene scene{.sigma_theta = 0.035, .sigma_s = 0.01, .sigma_e = 0.01};
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l)
      scene.landmarks[l] = {random.uniform(0.0, 4.5), (l % 2 ? 1.0 : -1.0) * random.uniform(0.8, 3.0)};
    const JointProblem problem = problem_of(scene, number);
    const Calibration a = closed_form_calibration(problem, of_order(2));
    const Calibration b = approximate_joint_calibration(problem, of_order(2));
    EXPECT_EQ(b.outcome, Outcome::converged) << number << ": " << b.reason;
    for (std::size_t l = 0; l < scene.landmarks.size(); ++l) {
      closed += (a.landmarks[l].position_m - scene.landmarks[l]).squaredNorm();
      approximate += (b.landmarks[l].position_m - scene.landmarks[l]).squaredNorm();
    }
  }
  EXPECT_LT(approximate, 0.5 * closed);  // ranges add what bearings of 2 degrees do not know: measured 0.33
}

/// Mean square of f's error at d over the variance stated, 200 repeats.
double square_over_variance(const BearingScene& scene, Estimator method, double d) {
  const int repeats = 200;
  const Eigen::Vector3d phi(1.0, d, d * d);
  double square = 0.0;
  for (std::uint64_t repeat = 0; repeat < repeats; ++repeat) {
    const Calibration c = method(problem_of(scene, seed_from("Covariance", {repeat})), of_order(2));
    const double error = phi.dot(c.alpha - scene.alpha);
    square += error * error / phi.dot(*c.alpha_covariance * phi) / repeats;
  }
  return square;
}

TEST(ClosedFormCalibration, CovarianceIsOfTheRightSize) {
  // Readings tell; stops tell, whose errors move all cells of a stop; and those that go on to all later stops:
  // taken for new in every cell the last two came out at 2 to 5. Four of sqrt(2 / 200) is 0.4; the rest is for
  // the bends left out.
  const BearingScene readings{.stops = 40, .sigma_theta = 0.005, .sigma_s = 0.003, .sigma_e = 0.01};
  const BearingScene stops{.stops = 20, .sigma_theta = 0.005, .sigma_s = 0.02, .sigma_e = 0.003};
  const BearingScene walk{
      .stops = 20, .sigma_theta = 0.005, .sigma_s = 0.002, .sigma_e = 0.003, .walk = true};
  for (const BearingScene& scene : {readings, stops, walk})
    for (const Estimator method : both)
      for (const double d : {1.0, 2.0, 3.0})
        EXPECT_NEAR(square_over_variance(scene, method, d), 1.0, 0.45)
            << scene.sigma_s << (method == closed_form_calibration ? " closed form " : " approximate ") << d;
}

/// (repeats - 1) times the variance of sigma_e as sampled over the variance as stated.
double squares_over_stated(const BearingScene& scene, int repeats, const std::string& name) {
  double mean = 0.0, square = 0.0, stated = 0.0;
  for (int repeat = 0; repeat < repeats; ++repeat) {
    const Calibration c = closed_form_calibration(
        problem_of(scene, seed_from(name, {static_cast<std::uint64_t>(repeat)})), of_order(2));
    const Estimate& sigma = c.noise_estimates.at(0);
    EXPECT_TRUE(sigma.std_dev) << c.reason;
    mean += sigma.value / repeats;
    square += sigma.value * sigma.value / repeats;
    stated += std::pow(sigma.std_dev.value_or(0.0), 2) / repeats;
  }
  return repeats * (square - mean * mean) / stated;
}

TEST(ClosedFormCalibration, StatesWhatIsKnownOfTheNoiseBesideTheStops) {
  // The variance sampled over the true one is chi-square; each limit is passed once in 10 000. What is stated is of first
  // order: sampled by another implementation, over 3000 repeats, 0.97 of what is sampled with 40 stops and 1.00 with 20; 1 / 1.05
  // allowed. Without what the curve's weights and the landmarks do to the residuals it was 0.87 and 0.84.
  const BearingScene many{.stops = 40, .sigma_theta = 0.01, .sigma_s = 0.01, .sigma_e = 0.01};
  const BearingScene few{.stops = 20, .sigma_theta = 0.01, .sigma_s = 0.01, .sigma_e = 0.01};
  for (const auto& [scene, repeats] : {std::pair(many, 1000), std::pair(few, 2000)}) {
    const double squares = squares_over_stated(scene, repeats, "SigmaStated");
    const boost::math::chi_squared law(repeats - 1.0);
    EXPECT_GT(squares, quantile(law, 1e-4) / 1.05) << scene.stops;              // 841 / 1.05; 1770 / 1.05
    EXPECT_LT(squares, 1.05 * quantile(complement(law, 1e-4))) << scene.stops;  // 1.05 * 1174; 1.05 * 2244
  }
}

TEST(ClosedFormCalibration, PolynomialNoiseIsPositiveAndOfTheRightSize) {
  BearingScene scene{.stops = 60, .repeats = 5, .sigma_theta = 0.005, .sigma_s = 0.0, .sigma_e = 0.01};
  scene.alpha = Eigen::VectorXd{{0.5, 0.9}};  // f^2 is then a polynomial of order 2
  ClosedFormOptions options = of_order(2);
  options.noise_law = NoiseLaw::polynomial;
  const Calibration c = closed_form_calibration(problem_of(scene, seed_from("Beta")), options);
  for (const double d : {0.8, 2.0, 3.5}) {
    const double f = evaluate_polynomial(scene.alpha, d);
    EXPECT_NEAR(c.noise.spread(d, f) / (0.01 * f * f), 1.0, 0.25) << d;
  }
  for (double d = c.range_min_m; d < c.range_max_m; d += 0.05) EXPECT_GT(c.noise.spread(d, d), 0.0);
}

TEST(ClosedFormCalibration, DegenerateRecordingsGetANamedOutcome) {
  BearingScene two_stops{
      .landmarks = {{1.0, 2.0}, {2.5, -1.5}}, .stops = 2, .sigma_theta = 0.01, .sigma_e = 0.01};
  BearingScene in_line{
      .landmarks = {{6.0, 0.0}, {7.0, 0.0}, {-2.0, 0.0}}, .sigma_theta = 0.01, .straight = true};
  in_line.sigma_s = 0.001;
  BearingScene nothing{.stops = 0};
  for (const Estimator method : both) {
    const Calibration a = method(problem_of(two_stops), {}),
                      b = closed_form_calibration(problem_of(in_line), {});
    EXPECT_EQ(a.outcome, Outcome::too_few_data);
    EXPECT_NE(a.reason.find("2 place(s)"), std::string::npos) << a.reason;
    EXPECT_EQ(b.outcome, Outcome::unobservable);  // 20 places to stand: not too few
    EXPECT_NE(b.reason.find("parallel"), std::string::npos) << b.reason;
    EXPECT_NE(b.weakest_direction.find("not determined along"), std::string::npos) << b.weakest_direction;
    EXPECT_EQ(a.alpha.size(), 0);
    EXPECT_EQ(b.alpha.size(), 0);
    EXPECT_EQ(method(problem_of(nothing), {}).outcome, Outcome::too_few_data);
  }
}

TEST(ClosedFormCalibration, AllAtOneDistanceIsNamed) {
  // stops on a circle of 2 m about the only landmark
  JointProblem problem = problem_of(BearingScene{.landmarks = {{0.0, 0.0}}, .stops = 12, .radius = 0.0});
  for (int k = 0; k < 12; ++k) {
    const double turn = 0.4 * k;
    problem.stops[k].commanded = {2.0 * std::cos(turn), 2.0 * std::sin(turn), turn};
    problem.cells.bearing_mean[k] = std::numbers::pi;
    problem.cells.range_mean[k] = 2.05 + 0.001 * (k % 3);
  }
  for (const Estimator method : both) {
    const Calibration c = method(problem, of_order(1));
    EXPECT_EQ(c.outcome, Outcome::too_few_data);
    EXPECT_NE(c.reason.find("distance"), std::string::npos) << c.reason;
  }
}

TEST(ClosedFormCalibration, LandmarkInLineIsLeftOutAndNamed) {
  BearingScene scene{.landmarks = {{7.0, 0.0}, {1.0, 2.0}, {3.0, -1.5}, {4.0, 3.0}}, .straight = true};
  const Calibration c = closed_form_calibration(problem_of(scene), of_order(2));
  EXPECT_EQ(c.outcome, Outcome::unobservable);
  EXPECT_LT((c.alpha - scene.alpha).cwiseAbs().maxCoeff(), 1e-10);
  EXPECT_FALSE(c.landmarks[0].covariance);
  EXPECT_TRUE(c.landmarks[1].covariance);
}

TEST(ClosedFormState, HasAllThatAnIterativeMethodNeeds) {
  BearingScene scene{.landmarks = {{7.0, 0.0}, {1.0, 2.0}, {3.0, -1.5}},
                     .sigma_theta = 0.01,
                     .sigma_s = 0.01,
                     .sigma_e = 0.01};
  for (const int order : {0, 1, 2}) {
    const JointState state = closed_form_state(problem_of(scene), of_order(order));
    EXPECT_EQ(state.alpha.size(), order + 1);
    EXPECT_EQ(state.stops.size(), 20u);
    EXPECT_EQ(state.landmarks.size(), 3u);
    EXPECT_GT(state.noise.parameters(0), 0.0);
    EXPECT_GT(state.sigma_theta_rad, 0.0);
  }
}

Recording pairs_of(int N, double sigma_e) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  Random random(seed_from("Pairs"));
  for (int k = 0; k < N; ++k) {
    const double d = 0.3 + 4.0 * k / (N - 1.0), f = 0.0525 + 0.8838 * d + 0.0584 * d * d;
    recording.pairs.true_m.push_back(d);
    recording.pairs.reading_m.push_back(f + sigma_e * f * f * random.normal());
  }
  return recording;
}

TEST(PairsCalibration, ExactAndNoiseRecovered) {
  for (const auto method : {closed_form_pairs, approximate_pairs}) {
    EXPECT_NEAR(method(pairs_of(40, 0.0), of_order(2)).alpha(1), 0.8838, 1e-10);
    const Calibration c = method(pairs_of(4000, 0.01), of_order(2));
    EXPECT_EQ(c.kind, RecordingKind::pairs);
    EXPECT_NEAR(c.noise.parameters(0), 0.01, 0.0005);  // four of 1.1 %
    EXPECT_NEAR(c.range_max_m, 4.3, 1e-12);
  }
  EXPECT_THROW(closed_form_pairs(Recording{}), InputError);
}

}  // namespace
}  // namespace rangecal
