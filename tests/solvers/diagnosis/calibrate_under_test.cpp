// SPDX-License-Identifier: BSD-3-Clause
#include <gtest/gtest.h>

#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

/// The value of a fit has to be that of its parameters, however the fit came there: where a fast bend was followed along, what
/// a reciprocal noise's Jacobian or a tail's weights add was that of the state before.
TEST(CalibrateUnder, ValuesAFitTheSameWhereItIsTakenUpAgain) {
  testing::SeedFit seed(testing::recording_with({{"bearing_scale", 0.004}}, "CalibrateUnder"));
  const auto at = [](const char* id, std::initializer_list<double> values) {
    ActiveEffect active{find_effect(id), Eigen::VectorXd(static_cast<Eigen::Index>(values.size()))};
    std::copy(values.begin(), values.end(), active.parameters.begin());
    return active;
  };
  const ActiveEffect lens = at("lens_distortion", {0.012});
  for (const ActiveEffect& other : {at("reciprocal_noise", {0.006}), at("heavy_tails", {0.03, 5.0})}) {
    const Model model{other, lens};
    JointState state = seed.fit.state;
    const double first = calibrate_under(seed.rows, model, state, seed.options);
    for (int again = 0; again < 2; ++again)
      EXPECT_NEAR(calibrate_under(seed.rows, model, state, seed.options), first, 0.1)
          << other.effect->info().id;
  }
}

}  // namespace
}  // namespace rangecal::diagnosis
