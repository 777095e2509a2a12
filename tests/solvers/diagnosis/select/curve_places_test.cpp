// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/select/curve_places.hpp"

#include <gtest/gtest.h>

#include <Eigen/Eigenvalues>
#include <cmath>
#include <map>
#include <set>
#include <string>

#include "diagnosis/select/hypothesis.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(CurvePlaces, CoverEveryChannelAlongEveryCovariate) {
  const testing::SeedFit seed(testing::recording_with({}, "CurvePlaces.Cover"));
  const WorkingProblem working = working_problem(seed.rows, {}, seed.fit.state);
  const Projector projector(seed.rows, working, seed.fit.state);
  const std::vector<CurvePlace> places = curve_places(seed.rows, projector, seed.fit.state.sigma_theta_rad);
  std::set<std::string> members;
  std::map<std::string, double> mass;  // of the shapes of a member
  for (const CurvePlace& place : places) {
    members.insert(member_name(*place.effect));
    mass[member_name(*place.effect)] += static_cast<double>(place.sizes.size()) / place.effect->choices;
    EXPECT_TRUE(is_generic(*place.effect));
    for (std::size_t i = 1; i < place.sizes.size(); ++i) EXPECT_GT(place.sizes[i], place.sizes[i - 1]);
  }
  for (const char* covariate : {"range", "sensor_bearing", "time", "repeat", "landmark", "stop", "radius"})
    for (const char* channel : {"range", "bearing"})
      EXPECT_TRUE(members.count(std::string("curve of ") + channel + " along " + covariate))
          << channel << " " << covariate;
  for (const auto& [member, sum] : mass)
    EXPECT_LE(sum, 1.0 + 1e-12) << member << ": masses sum to one at most";
}

TEST(CurvePlaces, AlongTheDistanceOfEachLandmarkOneSaysNothingOfTheOthers) {
  const testing::SeedFit seed(testing::recording_with({}, "CurvePlaces.ByLandmark"));
  const WorkingProblem working = working_problem(seed.rows, {}, seed.fit.state);
  const Projector projector(seed.rows, working, seed.fit.state);
  const Eigen::VectorXd x =
      values_along(seed.rows, projector.geometry(), covariate_of(seed.rows, range_by_landmark));
  constexpr int landmark = 2;
  int bases = 0;
  for (const CurvePlace& place : curve_places(seed.rows, projector, seed.fit.state.sigma_theta_rad)) {
    if (place.effect->info().covariate != range_by_landmark) continue;
    ++bases;
    EXPECT_EQ(place.effect->info().channel, "range");
    EXPECT_TRUE(place.effect->changes_with_distance());
    EXPECT_FALSE(place.effect->differs_between_repeats());
    const CurveBasis& basis = place.effect->basis();
    Eigen::VectorXd own(basis.size());
    for (Eigen::Index k = 0; k < own.size(); ++k)
      own[k] = std::floor(basis.knots[static_cast<std::size_t>(k)]) == landmark ? 1.0 : 0.0;
    EXPECT_GE(own.sum(), 3.0);
    for (std::size_t i = 0; i < seed.rows.size(); ++i)
      EXPECT_NEAR(basis.value(x[static_cast<Eigen::Index>(i)], own),
                  seed.rows.landmark[i] == landmark ? 1.0 : 0.0, 1e-12);
  }
  EXPECT_GE(bases, 1);
}

TEST(CurvePlaces, SmoothOnesAreGaussianProcessesLessWhatTheCalibrationAbsorbs) {
  const testing::SeedFit seed(testing::recording_with({}, "CurvePlaces.Smooth"));
  const WorkingProblem working = working_problem(seed.rows, {}, seed.fit.state);
  const Projector projector(seed.rows, working, seed.fit.state);
  std::map<std::string, int> of_member;
  for (const CurvePlace& place : curve_places(seed.rows, projector, seed.fit.state.sigma_theta_rad)) {
    const std::string& along = place.effect->info().covariate;
    const CurveBasis& basis = place.effect->basis();
    if (!place.effect->smooth || basis.groups || along == range_by_landmark) continue;
    const double length = of_member[member_name(*place.effect)]++ == 0 ? 0.6 : 0.15;
    const Eigen::MatrixXd& D = place.effect->directions();
    Eigen::MatrixXd K(D.rows(), D.rows());
    for (Eigen::Index i = 0; i < K.rows(); ++i)
      for (Eigen::Index j = 0; j < K.rows(); ++j) {
        const double r = std::sqrt(3.0) * std::abs(static_cast<double>(i - j)) /
                         (length * static_cast<double>(K.rows() - 1));
        K(i, j) = (1.0 + r) * std::exp(-r);
      }
    // What is left out is a part of the covariance, and not much of it.
    const Eigen::VectorXd left_out =
        Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd>(K - D * D.transpose()).eigenvalues();
    EXPECT_GT(left_out[0], -1e-9) << along;
    EXPECT_LT(left_out.sum(), 0.8 * K.trace()) << along;
  }
  EXPECT_GE(of_member.size(), 5u);
  for (const auto& [member, count] : of_member) EXPECT_EQ(count, 2) << member;
}

TEST(CurvePlaces, ACurveLeavesNoReadingsWithoutASpread) {
  // 22 knots beside two tails gained 21 774 nats on 2807 readings, with log variances of -26 to 72.
  CurveBasis basis;
  for (int k = 0; k < 22; ++k) basis.knots.push_back(k);
  const auto time = [](const ReadingView<double>& at) { return at.time_s; };
  const GenericEffect of_spread(CurveChannel::range_noise, "range_noise", "time", time, basis,
                                Eigen::MatrixXd::Identity(22, 22), 0.5);
  for (const EffectParameter& p : of_spread.info().parameters) {
    EXPECT_NEAR(std::exp(0.5 * p.high), 20.0, 1e-9);
    EXPECT_NEAR(std::exp(0.5 * p.low), 1.0 / 20.0, 1e-9);
  }
  const GenericEffect of_mean(CurveChannel::range, "range", "time", time, basis,
                              Eigen::MatrixXd::Identity(22, 22), 0.01);
  for (const EffectParameter& p : of_mean.info().parameters) EXPECT_EQ(p.high, 10.0);
}

TEST(CurvePlaces, AStepInTimeIsNothingBeforeIt) {
  const testing::SeedFit seed(testing::recording_with({}, "CurvePlaces.Step"));
  const WorkingProblem working = working_problem(seed.rows, {}, seed.fit.state);
  const Projector projector(seed.rows, working, seed.fit.state);
  int steps = 0;
  for (const CurvePlace& place : curve_places(seed.rows, projector, seed.fit.state.sigma_theta_rad)) {
    const EffectInfo& info = place.effect->info();
    if (info.covariate != "time" || info.channel != "range" || info.parameters.size() != 1) continue;
    ++steps;
    const double at = place.effect->basis().knots.back(), size = 0.01;
    for (std::size_t i = 0; i < seed.rows.size(); i += 37) {
      const double change = place.effect->reading(view_of(seed.rows, projector.geometry(), i), &size).range;
      EXPECT_NEAR(change, seed.rows.time_s[i] >= at ? size : 0.0, 1e-12);
    }
  }
  EXPECT_EQ(steps, seed.rows.context.stop_count - 1);
}

}  // namespace
}  // namespace rangecal::diagnosis
