// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/noise.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

TEST(Noise, HandWorkedSpreads) {
  // sigma = 0.5 at d = 3, f = -2; the polynomial law 0.5 + 0.1 d + 0.01 d^2 = 0.89.
  const struct {
    NoiseLaw law;
    double spread;
    int power;
  } laws[] = {{NoiseLaw::constant, 0.5, 0}, {NoiseLaw::f, 1.0, 1},         {NoiseLaw::f_squared, 2.0, 2},
              {NoiseLaw::f_cubed, 4.0, 3},  {NoiseLaw::d_squared, 4.5, 0}, {NoiseLaw::polynomial, 0.89, 0}};
  for (const auto& [law, spread, power] : laws) {
    SCOPED_TRACE(to_string(law));
    const Noise noise{law, Eigen::Vector3d(0.5, 0.1, 0.01)};
    EXPECT_NEAR(noise.spread(3.0, -2.0), spread, 1e-15);
    EXPECT_EQ(noise.power_of_f(), power);
    EXPECT_EQ(noise_law_from_string(to_string(law)), law);
  }
  EXPECT_THROW(noise_law_from_string("f4"), InputError);
}

}  // namespace
}  // namespace rangecal
