// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/correction_table.hpp"

#include <fmt/format.h>
#include <gtest/gtest.h>

#include <cmath>
#include <numbers>
#include <string>

#include "rangecal/core/random.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "support/calibration_of.hpp"

namespace rangecal {
namespace {

using testing::calibration_of;

/// Readings from 1 mm to beyond all that the calibration knows: the table gives what correction_candidates gives first.
void expect_exact(const Calibration& calibration, bool by_bearing, const std::string& name,
                  double share_of_exact) {
  SCOPED_TRACE(name);
  const EffectCorrector corrector(calibration, {});
  CorrectionTable table(corrector, by_bearing);
  Random random(seed_from("CorrectionTable." + name));
  for (int i = 0; i < 4000; ++i) {
    const double y = random.uniform(0.001, 2.0 * calibration.range_max_m);
    ReadingSetting setting;
    if (by_bearing) setting.bearing_rad = random.uniform(-std::numbers::pi, std::numbers::pi);
    const CorrectionCandidate exact = correction_candidates(corrector, y, setting, false).front();
    const CorrectionTable::Answer found = table(y, by_bearing ? setting.bearing_rad : 0.0);
    ASSERT_EQ(exact.distance_m.has_value(), std::isfinite(found.distance_m)) << y;
    const auto flagged = [&](const char* word) { return exact.flag.find(word) != std::string::npos; };
    EXPECT_EQ((found.flags & CorrectionTable::ambiguous) != 0, flagged("ambiguous")) << y;
    EXPECT_EQ((found.flags & CorrectionTable::out_of_range) != 0, flagged("out_of_range")) << y;
    if (!exact.distance_m) continue;
    EXPECT_NEAR(found.distance_m, *exact.distance_m, 1e-9) << y << " at " << setting.bearing_rad;
    const bool at_an_end = std::abs(*exact.distance_m - calibration.range_min_m) < 2e-9 ||
                           std::abs(*exact.distance_m - calibration.range_max_m) < 2e-9;
    if (!at_an_end) {
      EXPECT_EQ((found.flags & CorrectionTable::extrapolated) != 0, flagged("extrapolated")) << y;
    }
  }
  EXPECT_GT(table.cells(), 0u);
  EXPECT_LE(static_cast<double>(table.exact_cells()), share_of_exact * static_cast<double>(table.cells()));
}

TEST(CorrectionTable, IsTheExactRootToANanometre) {
  expect_exact(calibration_of(Eigen::Vector2d(0.03, 0.97), NoiseLaw::f_squared, 0.01), false, "line", 0.01);
  expect_exact(calibration_of(Eigen::Vector3d(0.03, 0.95, 0.02), NoiseLaw::d_squared, 0.01), false,
               "quadratic", 0.01);
  Eigen::VectorXd cubic(4);
  cubic << -0.02, 1.03, -0.03, 0.004;
  expect_exact(calibration_of(cubic, NoiseLaw::constant, 0.01), false, "cubic", 0.01);
  // turns at 3.125 m, in the middle of the range: two distances behind most readings
  expect_exact(calibration_of(Eigen::Vector3d(0.0, 1.25, -0.2), NoiseLaw::constant, 0.01), false, "fold",
               0.02);
}

TEST(CorrectionTable, OfAReciprocalCurveToo) {
  Calibration c = calibration_of(Eigen::Vector2d(0.1, 0.9), NoiseLaw::constant, 0.005);
  c.scale.family = CurveFamily::reciprocal;
  c.scale.offset_m = 0.05;  // falls: far things have small readings, where the curve is steep
  expect_exact(c, false, "reciprocal", 0.3);
}

TEST(CorrectionTable, WithEffectsOfTheBearing) {
  Calibration c = calibration_of(Eigen::Vector3d(0.03, 0.97, 0.004), NoiseLaw::constant, 0.004);
  c.effects["range_eccentricity"] = {{"cosine_m", 0.006}, {"sine_m", -0.004}};
  expect_exact(c, true, "eccentricity", 0.05);
}

TEST(CorrectionTable, WhereAnEffectJumpsTheAnswerIsExact) {
  Calibration c = calibration_of(Eigen::Vector2d(0.0, 1.0), NoiseLaw::constant, 0.001);
  c.kind = RecordingKind::pairs;
  c.effects["near_regime"] = {{"offset_m", 0.03}, {"slope", 0.0}, {"limit_m", 1.0}};
  expect_exact(c, false, "jump", 0.02);
}

}  // namespace
}  // namespace rangecal
