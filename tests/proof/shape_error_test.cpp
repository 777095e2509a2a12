// SPDX-License-Identifier: BSD-3-Clause
#include "proof/shape_error.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <string>
#include <vector>

#include "proof/rows.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"

namespace rangecal::proof {
namespace {

/// u of the head of shape_error.hpp.
Eigen::VectorXd whitened_change(const world::World& clean, const world::World& planted) {
  const world::Expected before = world::expected(clean);
  Eigen::VectorXd u = change_of_means(world::expected(planted), before);
  const auto n = static_cast<Eigen::Index>(before.stop.size());
  for (Eigen::Index i = 0; i < n; ++i) {
    u[i] /= before.range_sd_m[static_cast<std::size_t>(i)];
    u[n + i] /= before.bearing_sd_rad[static_cast<std::size_t>(i)];
  }
  return u;
}

TEST(ShapeError, IsATenthOfTheChangeAndNoChangeOfSize) {
  for (const char* design : {"line", "turning"})
    for (const world::EffectInfo& info : world::effect_table()) {
      if (!info.catalogued || info.effect_class != world::EffectClass::mean) continue;
      SCOPED_TRACE(info.id + " " + design);
      const world::World clean =
          std::string(design) == "line" ? world::make_line_design() : world::make_turning_design();
      Random random(5);
      const world::World planted = world::apply(clean, info.id, info.typical, random);
      const std::vector<double> error = shape_error(clean, planted, info.id, random);
      const Eigen::VectorXd u = whitened_change(clean, planted);
      const Eigen::ArrayXd e = Eigen::Map<const Eigen::ArrayXd>(error.data(), u.size() / 2);
      const Eigen::VectorXd off = (e.replicate(2, 1) * u.array()).matrix();
      EXPECT_NEAR(off.norm(), 0.1 * u.norm(), 1e-9 * u.norm());
      EXPECT_NEAR(off.dot(u), 0.0, 1e-9 * u.squaredNorm());
    }
}

TEST(ShapeError, OfAChangeThatIsTheSameForAllByHand) {
  // An encoder zero turns all bearings alike: u is constant, so c is the mean of g and e has mean 0 and RMS 0.1.
  const world::World clean = world::make_line_design();
  Random random(6);
  const world::World planted = world::apply(clean, "bearing_offset", 0.01, random);
  const std::vector<double> error = shape_error(clean, planted, "bearing_offset", random);
  double sum = 0.0, squares = 0.0;
  for (const double e : error) sum += e, squares += e * e;
  const auto n = static_cast<double>(error.size());
  EXPECT_NEAR(sum / n, 0.0, 1e-12);
  EXPECT_NEAR(std::sqrt(squares / n), 0.1, 1e-12);
}

TEST(ShapeError, IsInTheRecordingAndLeavesItsNoise) {
  const Case c = draw_case("formula-off", 3, 1, "turning"), same = draw_case("formula-off", 3, 1, "turning");
  EXPECT_EQ(c.shape_error, same.shape_error);
  Case exact = c;
  exact.shape_error.clear();
  const Recording off = record(c, c.planted), on = record(exact, exact.planted);
  ASSERT_EQ(off.readings.size(), on.readings.size());
  // Stops a centimetre elsewhere change the change of a smooth law little: e u of the nominal stops is nearly what was added.
  const Eigen::VectorXd change = change_of_means(world::expected(c.planted), world::expected(c.clean));
  double added = 0.0, wanted = 0.0;
  ASSERT_EQ(off.readings.size(), c.shape_error.size());
  for (std::size_t i = 0; i < off.readings.size(); ++i) {
    const auto at = static_cast<Eigen::Index>(i);
    const auto n = static_cast<Eigen::Index>(off.readings.size());
    added += std::pow(off.readings.range_m[i] - on.readings.range_m[i], 2) +
             std::pow(wrap_angle(off.readings.bearing_rad[i] - on.readings.bearing_rad[i]), 2);
    wanted += std::pow(c.shape_error[i] * change[at], 2) + std::pow(c.shape_error[i] * change[n + at], 2);
  }
  EXPECT_GT(wanted, 0.0);
  EXPECT_NEAR(added / wanted, 1.0, 0.1);
}

TEST(FormulaOff, IsOf400And1600InTurns) {
  EXPECT_NEAR(draw_case("formula-off", 3, 0, "line").value, 400.0, 20.0);
  EXPECT_NEAR(draw_case("formula-off", 3, 2, "line").value, 1600.0, 80.0);
}

}  // namespace
}  // namespace rangecal::proof
