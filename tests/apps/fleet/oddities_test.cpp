// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/oddities.hpp"

#include <gtest/gtest.h>

#include <cmath>

namespace rangecal::app {
namespace {

using Eigen::Vector3d;
using Eigen::Vector4d;

TEST(FleetOddities, DifferencesHaveTheirSizeAndTheirT) {
  // log 0.88 is 12 % less
  EXPECT_EQ(difference_in_words(Vector3d(0.072, 0.004, std::log(0.88)), Vector3d(14.1, 2.9, -3.3)),
            "calibration differs from the population's: alpha_0 +72 mm (+14.1 sd), sigma -12 % (-3.3 sd)");
}

TEST(FleetOddities, CoefficientsHaveTheirUnits) {
  EXPECT_EQ(
      difference_in_words(Vector4d(-0.0015, 0.31, -0.0125, 0.7), Vector4d(-3.0, 4.0, -5.0, 0.1)),
      "calibration differs from the population's: alpha_2 -0.0125 1/m (-5.0 sd), alpha_1 +0.31 (+4.0 sd), "
      "alpha_0 -1.5 mm (-3.0 sd)");
}

TEST(FleetOddities, ACombinationIsSaidToBeOne) {
  EXPECT_EQ(difference_in_words(Vector3d(0.01, 0.05, 0.0), Vector3d(-1.9, 2.1, 0.0)),
            "calibration differs from the population's: no parameter by 3 sd, alpha_1 +0.05 (+2.1 sd) the "
            "furthest: their combination is odd");
}

}  // namespace
}  // namespace rangecal::app
