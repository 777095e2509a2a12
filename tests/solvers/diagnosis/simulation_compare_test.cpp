// SPDX-License-Identifier: BSD-3-Clause
// A calibration held against recordings: its noise, and the sampling error that it states of its curve.
#include "diagnosis/simulation_compare.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <algorithm>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal {
namespace {

using ::testing::HasSubstr;

/// One power law and, where `sigma_theta_rad` is positive, bearings; levels known to `relative`.
Calibration levels_of(double sigma, double sigma_theta_rad, double relative) {
  Calibration c;
  c.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, sigma)};
  c.noise_estimates = {{sigma, relative * sigma}};
  if (sigma_theta_rad > 0.0) c.sigma_theta_rad = Estimate{sigma_theta_rad, relative * sigma_theta_rad};
  return c;
}

TEST(SimulationCompare, APValueIsTwoSidedForEachLevelCompared) {
  // ln 1.2 = 0.1823 over sqrt(2) 0.0322 is 4.0038 standard deviations: erfc(4.0038 / sqrt 2) = 6.2346e-5.
  Diagnosis pairs;
  diagnosis::compare_noise(levels_of(0.01, 0.0, 0.0322), levels_of(0.012, 0.0, 0.0322), pairs);
  ASSERT_EQ(pairs.location.size(), 1u);
  EXPECT_NEAR(pairs.location[0].p_value, 6.2346e-5, 1e-9);
  EXPECT_EQ(pairs.verdict, Verdict::unexplained);
  // Bearings of the same level are compared, too: twice as much.
  Diagnosis both;
  diagnosis::compare_noise(levels_of(0.01, 0.02, 0.0322), levels_of(0.012, 0.02, 0.0322), both);
  ASSERT_EQ(both.location.size(), 1u);
  EXPECT_EQ(both.location[0].channel, "range_noise");
  EXPECT_NEAR(both.location[0].p_value, 2.0 * pairs.location[0].p_value, 1e-18);
  // Three standard deviations are no finding.
  Diagnosis alike;
  diagnosis::compare_noise(levels_of(0.01, 0.02, 0.043), levels_of(0.012, 0.02, 0.043), alike);
  EXPECT_TRUE(alike.location.empty());
  EXPECT_EQ(alike.verdict, Verdict::no_mismatch);
}

/// The curve of made_recordings.hpp with a sampling error.
Calibration stated_curve(const Eigen::MatrixXd& covariance) {
  Calibration c;
  c.outcome = Outcome::converged;
  c.alpha = Eigen::Vector3d(0.05, 0.9, 0.05);
  c.alpha_covariance = covariance;
  c.noise = {NoiseLaw::f_squared, Eigen::VectorXd::Constant(1, 0.002)};
  return c;
}

Diagnosis held_against(const Recording& recording, const Calibration& simulation) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.simulation = simulation;
  return diagnose(std::span(&recording, 1), options);
}

TEST(SimulationCompare, ACovarianceThatIsNoneIsSaidAndNotTakenForCertainty) {
  // A coefficient and a twin of it, correlated by more than 1 since they were rounded. As "known exactly" a curve that is
  // off by a few of its standard deviations was a mismatch.
  const Recording recording = testing::recording_of({.sigma = 0.002}, "SimulationCompare.Covariance", 1);
  Eigen::Matrix3d covariance = Eigen::Vector3d(4e-4, 4e-4, 4e-5).asDiagonal();
  covariance(0, 1) = covariance(1, 0) = -4.1e-4;
  try {
    held_against(recording, stated_curve(covariance));
    FAIL() << "an indefinite covariance was taken";
  } catch (const InputError& error) {
    EXPECT_THAT(error.what(), HasSubstr("covariance is not positive definite"));
  }
  // Half a centimetre of offset, which its own sampling error of 2 cm allows.
  covariance(0, 1) = covariance(1, 0) = 0.0;
  Calibration off = stated_curve(covariance);
  off.alpha[0] += 0.005;
  EXPECT_EQ(held_against(recording, off).verdict, Verdict::no_mismatch);
  // No error at all is no covariance, but an exact curve.
  off.alpha_covariance = Eigen::Matrix3d::Zero();
  Calibration exact = off;
  exact.alpha_covariance.reset();
  const Diagnosis zero = held_against(recording, off), none = held_against(recording, exact);
  EXPECT_EQ(zero.before.nll, none.before.nll);
  EXPECT_EQ(zero.final_effects, none.final_effects);
}

TEST(SimulationCompare, ANoteOfTheSimulationSaysWhoseItIs) {
  Recording recording = testing::recording_of({.sigma = 0.002}, "SimulationCompare.Notes", 1);
  Recording simulation = testing::recording_of({.sigma = 0.002}, "SimulationCompare.Notes", 2);
  recording.notes = {"own.csv: a column is left out"};
  simulation.notes = {"sim.csv: a column is left out"};
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  const std::vector<std::string> notes =
      diagnose_against(std::span(&recording, 1), std::span(&simulation, 1), options).notes;
  EXPECT_EQ(std::count(notes.begin(), notes.end(), "own.csv: a column is left out"), 1);
  EXPECT_EQ(std::count(notes.begin(), notes.end(), "of the simulation: sim.csv: a column is left out"), 1);
}

// The stops of a second run stand millimetres apart, where the wobble has another phase: reading by reading it does not cancel, and
// what is left was named `pixel_locking` against the very model that holds it.
TEST(SimulationCompare, OneModelAccountsForAWobbleOfBothAndNotForAnotherSize) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  const Recording recording = testing::recording_with({{"pixel_locking", 0.25}}, "SimulationCompare.Wobble");
  const std::span<const Recording> recordings(&recording, 1);
  Diagnosis alone = diagnose(recordings, options);
  ASSERT_EQ(alone.final_effects, std::vector<std::string>{"pixel_locking"}) << alone.sentence;
  EXPECT_TRUE(diagnosis::one_model_accounts_for(recordings, simulate(alone.simulation, 1), options));
  for (const char* part : {"cosine_per_m", "sine_per_m"})
    alone.simulation.calibration.effects.at("pixel_locking").at(part) *= 2.0;
  EXPECT_FALSE(diagnosis::one_model_accounts_for(recordings, simulate(alone.simulation, 2), options));
}

}  // namespace
}  // namespace rangecal
