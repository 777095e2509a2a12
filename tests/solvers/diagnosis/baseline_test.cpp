// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "diagnosis/search.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "support/paper_scene.hpp"

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

}  // namespace
}  // namespace rangecal::diagnosis
