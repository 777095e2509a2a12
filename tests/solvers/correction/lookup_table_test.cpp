// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/lookup_table.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// The largest error of a table between `low` and `high`, looked at more finely than it was made.
double worst_error(const LookupTable& table, const std::function<SensorReading(double)>& sensor, double low,
                   double high) {
  double worst = 0.0;
  for (int i = 0; i <= 20000; ++i) {
    const double d = low + (high - low) * i / 20000;
    const SensorReading truth = sensor(d), found = table.at(d);
    worst =
        std::max({worst, std::abs(truth.mean_m - found.mean_m), std::abs(truth.std_dev_m - found.std_dev_m)});
  }
  return worst;
}

TEST(LookupTable, OfALineTwoRows) {
  const LookupTable table = fewest_rows(
      [](double d) {
        return SensorReading{0.9 * d, 0.018 * d};
      },
      0.5, 4.0, 1e-4);
  ASSERT_EQ(table.rows.size(), 2u);  // the mean is linear, the noise is 2 % of it everywhere
  EXPECT_DOUBLE_EQ(table.rows[0].distance_m, 0.5);
  EXPECT_DOUBLE_EQ(table.rows[1].distance_m, 4.0);
  EXPECT_NEAR(table.rows[1].mean_m, 3.6, 1e-12);
  EXPECT_NEAR(table.rows[1].relative_std_dev, 0.02, 1e-12);
  EXPECT_LT(table.mean_error_m, 1e-12);
  EXPECT_NEAR(table.at(9.0).mean_m, 3.6, 1e-12);  // beyond the end as at the end
}

TEST(LookupTable, OfAParabolaAsManyRowsAsTheSagittaSays) {
  // f = d + 0.05 d^2: a chord of length h is off by f'' h^2 / 8 = 0.0125 h^2, whatever its place. For 1 mm h = 0.283 m: 4 m take
  // 15 chords (14.14), 16 rows.
  const auto parabola = [](double d) { return SensorReading{d + 0.05 * d * d, 0.0}; };
  const LookupTable table = fewest_rows(parabola, 0.5, 4.5, 1e-3);
  EXPECT_EQ(table.rows.size(), 16u);
  EXPECT_LE(worst_error(table, parabola, 0.5, 4.5),
            1e-3 + 1e-8);  // between the places looked at, 1e-6 of a chord
  EXPECT_LE(table.mean_error_m, 1e-3);
  EXPECT_EQ(fewest_rows(parabola, 0.5, 4.5, 1e-3 / 4.0).rows.size(), 30u);  // h = 0.1414 m: 28.3 chords
}

TEST(LookupTable, NoiseAloneMayAskForRows) {
  const auto growing = [](double d) {
    return SensorReading{d, 0.01 * d * d};
  };  // relative: 0.01 d, linear: two rows
  EXPECT_EQ(fewest_rows(growing, 0.5, 4.5, 1e-4).rows.size(), 2u);
  const auto constant = [](double d) { return SensorReading{d, 0.02}; };  // relative: 0.02 / d
  const LookupTable table = fewest_rows(constant, 0.5, 4.5, 1e-3);
  EXPECT_GT(table.rows.size(), 2u);
  EXPECT_LE(worst_error(table, constant, 0.5, 4.5), 1e-3 + 1e-6);
}

TEST(LookupTable, AJumpIsCrossedAndSaid) {
  const auto jump = [](double d) { return SensorReading{d + (d < 2.0 ? 0.03 : 0.0), 0.001}; };
  const LookupTable table = fewest_rows(jump, 1.0, 3.0, 1e-3);
  EXPECT_LE(table.rows.size(), 8u);
  EXPECT_GT(table.mean_error_m, 1e-3);
  EXPECT_LE(table.mean_error_m, 0.03);
}

TEST(LookupTable, RefusesWhatHasNoTable) {
  const auto line = [](double d) { return SensorReading{d - 1.0, 0.01}; };
  EXPECT_THROW(fewest_rows(line, 0.5, 4.0, 1e-3), InputError);
  EXPECT_THROW(fewest_rows(line, 2.0, 4.0, 0.0), InputError);
  EXPECT_THROW(fewest_rows(line, 4.0, 2.0, 1e-3), InputError);
}

}  // namespace
}  // namespace rangecal
