// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/mean_squared_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <vector>

namespace rangecal {
namespace {

TEST(MeanSquaredError, HandWorked) {
  // raw errors 0.2 and 0.4: MSE (0.04 + 0.16)/2 = 0.1; corrected 0.1 and 0.1: 0.01; ratio 10
  // normalised raw: (0.2/1)^2 + (0.4/2)^2 = 0.08, over 2 = 0.04
  const std::vector<double> d{1.0, 2.0}, raw{1.2, 2.4}, corrected{1.1, 1.9};
  EXPECT_NEAR(mean_squared_error(d, raw), 0.1, 1e-12);
  EXPECT_NEAR(normalised_mean_squared_error(d, raw), 0.04, 1e-12);
  EXPECT_NEAR(mse_ratio(d, raw, corrected), 10.0, 1e-9);
}

TEST(MeanSquaredError, DegenerateInput) {
  EXPECT_TRUE(std::isnan(mean_squared_error({}, {})));
  EXPECT_THROW(mean_squared_error(std::vector<double>{1.0}, {}), InputError);
}

}  // namespace
}  // namespace rangecal
