// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <vector>

#include "diagnosis/search.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/paper_scene.hpp"
#include "support/planted_scene.hpp"

namespace rangecal::diagnosis {
namespace {

TEST(Baseline, IsNotLedAstrayByDrift) {
  // At an optimum the marginal NLL is below that of the truth. From the commanded path alone a search ends
  // thousands of nats above it, and all that would be called a mismatch.
  for (std::uint64_t repeat = 0; repeat < 2; ++repeat) {
    const Recording r = simulate(testing::long_walk(), seed_from("baseline", {repeat}));
    const LaplaceValue at_truth = laplace_marginal(make_joint_problem({&r, 1}), testing::truth_of(r));
    ASSERT_TRUE(at_truth.ok);
    RefitOptions refit_options;
    const Fit fit = fit_baseline(make_rows({&r, 1}), {}, refit_options);
    EXPECT_LT(fit.nll, at_truth.marginal_nll) << repeat;
  }
}

TEST(Baseline, StartsWhereOutliersBendTheCurveBelowZero) {
  Recording recording = simulate_scene(testing::planted_scene("range_offset: {offset_m: 0}"), 1);
  int outliers = 0;
  for (std::size_t i = 0; i < recording.readings.range_m.size(); i += 8)
    if (double& y = recording.readings.range_m[i]; y > 0.6 && y < 1.2) {
      y = 9.9;
      ++outliers;
    }
  ASSERT_EQ(outliers, 30);  // of 1000
  const Rows rows = make_rows({&recording, 1});
  const JointState start = position_seed(rows.problem, 2, NoiseLaw::f_squared);
  const std::vector<double> f = cell_geometry(rows, start).f;
  ASSERT_LT(*std::min_element(f.begin(), f.end()), 0.0);
  RefitOptions refit_options;
  const Fit fit = fit_baseline(rows, {}, refit_options);
  EXPECT_TRUE(fit.ok);
  EXPECT_TRUE(std::isfinite(fit.nll));
}

}  // namespace
}  // namespace rangecal::diagnosis
