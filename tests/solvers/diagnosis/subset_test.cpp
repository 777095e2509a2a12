// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/subset.hpp"

#include <gtest/gtest.h>

#include <cmath>

#include "diagnosis/working.hpp"
#include "solvers/diagnosis/made_recordings.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

/// Landmarks of which one range in ten is too long by some 30 cm.
Recording with_late_readings() {
  Recording recording = testing::recording_of({}, "LaplaceValue", 1);
  Random random(seed_from("LaplaceValue", {2}));
  for (double& range : recording.readings.range_m)
    if (random.uniform() < 0.1) range += 0.3 * -std::log(1.0 - random.uniform());
  return recording;
}

TEST(LaplaceValue, WithTailsDoesNotDependOnWhereTheStopsWere) {
  const testing::SeedFit seed(with_late_readings());
  const Effect* late = find_effect("late_return");
  Eigen::VectorXd parameters(2);
  for (int j = 0; j < 2; ++j)
    parameters[j] = late->info().parameters[static_cast<std::size_t>(j)].name == "share" ? 0.1 : 0.3;
  const Model model{{late, parameters}};
  JointState at_optimum = with_robust_noise(seed.rows, {}, seed.fit.state);
  laplace_value(seed.rows, model, at_optimum);
  JointState again = at_optimum;
  const double value = laplace_value(seed.rows, model, again);
  JointState moved = at_optimum;  // as a stop that was left out is where it was meant to be
  Random random(seed_from("LaplaceValue", {3}));
  for (Pose2& stop : moved.stops) {
    stop.x_m += random.normal(0.0, 0.02);
    stop.y_m += random.normal(0.0, 0.02);
  }
  EXPECT_NEAR(laplace_value(seed.rows, model, moved), value, 0.1);
  EXPECT_NEAR(nll_at(seed.rows, working_problem(seed.rows, model, moved), moved),
              nll_at(seed.rows, working_problem(seed.rows, model, again), again), 0.1);
}

}  // namespace
}  // namespace rangecal::diagnosis
