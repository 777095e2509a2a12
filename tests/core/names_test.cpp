// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/names.hpp"

#include <gtest/gtest.h>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/noise.hpp"
#include "rangecal/core/outcome.hpp"

namespace rangecal {
namespace {

TEST(Names, OutcomesRoundTrip) {
  for (const Outcome outcome : {Outcome::converged, Outcome::not_converged, Outcome::unbounded,
                                Outcome::unobservable, Outcome::too_few_data, Outcome::failed}) {
    EXPECT_EQ(outcome_from_string(to_string(outcome)), outcome);
  }
  EXPECT_THROW(outcome_from_string("fine"), InputError);
}

TEST(Names, MethodsRoundTrip) {
  for (const Method method : {Method::closed_form, Method::approximate, Method::full, Method::marginal}) {
    EXPECT_EQ(method_from_string(to_string(method)), method);
  }
  EXPECT_THROW(method_from_string("closed_form"), InputError);
}

TEST(Names, NoiseLawsRoundTripAndTheErrorListsThem) {
  for (const NoiseLaw law : {NoiseLaw::constant, NoiseLaw::f, NoiseLaw::f_squared, NoiseLaw::f_cubed,
                             NoiseLaw::d_squared, NoiseLaw::polynomial}) {
    EXPECT_EQ(noise_law_from_string(to_string(law)), law);
  }
  try {
    noise_law_from_string("f4");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "noise law is 'f4', not one of constant, f, f2, f3, d2, polynomial");
  }
}

TEST(Names, OfAValueWithTwoTextsTheFirstIsWrittenAndBothAreRead) {
  enum class Side { left, right, neither };
  constexpr auto names =
      names_of<Side>("side", {{Side::left, "left"}, {Side::left, "port"}, {Side::right, "right"}});
  static_assert(names.find("port") == Side::left && names.find("right") == Side::right);
  static_assert(!names.find("") && !names.find("Left") && !names.find("lef"));
  EXPECT_STREQ(names.name_of(Side::left), "left");
  EXPECT_STREQ(names.name_of(Side::neither), "");
  EXPECT_EQ(names.list(), "left, right");
  EXPECT_EQ(names.value_of("port"), Side::left);
  try {
    names.value_of("up");
    FAIL();
  } catch (const InputError& error) {
    EXPECT_STREQ(error.what(), "side is 'up', not one of left, right");
  }
}

TEST(Names, SpreadOfEachLaw) {
  // sigma = 0.1, d = 2, f = -3: 0.1; 0.1*3; 0.1*9; 0.1*27; 0.1*4; beta (0.1, 0.2): 0.1 + 0.2*2
  Noise noise{NoiseLaw::constant, Eigen::VectorXd::Constant(1, 0.1)};
  const auto spread = [&](NoiseLaw law) {
    noise.law = law;
    return noise.spread(2.0, -3.0);
  };
  EXPECT_NEAR(spread(NoiseLaw::constant), 0.1, 1e-15);
  EXPECT_NEAR(spread(NoiseLaw::f), 0.3, 1e-15);
  EXPECT_NEAR(spread(NoiseLaw::f_squared), 0.9, 1e-15);
  EXPECT_NEAR(spread(NoiseLaw::f_cubed), 2.7, 1e-15);
  EXPECT_NEAR(spread(NoiseLaw::d_squared), 0.4, 1e-15);
  noise.parameters = Eigen::Vector2d(0.1, 0.2);
  EXPECT_NEAR(spread(NoiseLaw::polynomial), 0.5, 1e-15);
}

}  // namespace
}  // namespace rangecal
