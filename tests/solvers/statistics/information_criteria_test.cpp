// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/statistics/information_criteria.hpp"

#include <gtest/gtest.h>

namespace rangecal {
namespace {

TEST(InformationCriteria, HandWorked) {
  // nll = 10, p = 3, N = 13: AIC = 20 + 6 = 26; AICc = 26 + 2*3*4/(13-3-1) = 26 + 24/9; BIC = 20 + 3 log 13
  EXPECT_DOUBLE_EQ(aic(10.0, 3.0), 26.0);
  EXPECT_DOUBLE_EQ(aicc(10.0, 3.0, 13.0), 26.0 + 24.0 / 9.0);
  EXPECT_NEAR(bic(10.0, 3.0, 13.0), 27.6948480724, 1e-9);
}

TEST(InformationCriteria, AiccIsInfiniteWithoutDegreesOfFreedom) {
  EXPECT_TRUE(std::isinf(aicc(10.0, 3.0, 4.0)));
}

}  // namespace
}  // namespace rangecal
