// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <gtest/gtest.h>

#include <cmath>
#include <cstddef>
#include <vector>

namespace rangecal::testing {

/// Expects the first parameters of x, as many as there are steps of differences, to lie less than `most` standard deviations, by the curvature
/// there, from the least value of nll(x) along each.
template <typename NLL, typename Parameters>
void expect_optimum(const NLL& nll, const Parameters& x, const std::vector<double>& steps, double most) {
  for (std::size_t j = 0; j < steps.size(); ++j) {
    const auto at = [&](double side) {
      Parameters moved = x;
      moved[j] += side * steps[j];
      return nll(moved);
    };
    const double score = (at(1.0) - at(-1.0)) / (2.0 * steps[j]);
    const double information = (at(1.0) - 2.0 * at(0.0) + at(-1.0)) / (steps[j] * steps[j]);
    ASSERT_GT(information, 0.0) << j;
    EXPECT_LT(std::abs(score) / std::sqrt(information), most) << j;
  }
}

}  // namespace rangecal::testing
