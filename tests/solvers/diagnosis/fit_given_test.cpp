// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/fit_given.hpp"

#include <gtest/gtest.h>

#include <algorithm>

#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal {
namespace {

TEST(FitGiven, TheOrderOfTheNamesDoesNotMatter) {
  // Which landmark is the odd one shows only beside the large causes.
  const Recording recording = testing::recording_with(
      {{"bearing_scale", -0.0024}, {"sweep_motion", 0.43}, {"target_reflectance", 0.006}}, "FitGiven.Order");
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  std::vector<std::string> names = {"bearing_scale", "sweep_motion", "target_reflectance"};
  std::vector<double> nlls;
  do {
    options.force = names;
    nlls.push_back(diagnose({&recording, 1}, options).after.nll);
  } while (std::next_permutation(names.begin(), names.end()));
  ASSERT_EQ(nlls.size(), 6u);
  for (const double nll : nlls) EXPECT_NEAR(nll, nlls.front(), 1e-6);
  options.force.reset();
  EXPECT_LT(nlls.front(), diagnose({&recording, 1}, options).after.nll + 0.1)
      << "as likely as what a search finds, or more";
}

// An offset of all bearings turns what a slip moves. Linearised where neither is known, the likeliest stop is often the one beside the right one.
TEST(FitGiven, AStopIsChosenAnewBesideTheOtherCauses) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.force = {"bearing_offset", "wheel_slip"};
  int right = 0;
  constexpr int worlds = 6;
  for (int i = 0; i < worlds; ++i) {
    Random random(seed_from("FitGiven.Stop", {static_cast<std::uint64_t>(i)}));
    world::World world = world::apply(world::make_line_design(), "bearing_offset", 0.041, random);
    world = world::apply(world, "wheel_slip", -0.132, random);
    const Recording recording =
        world::simulate(world, seed_from("FitGiven.Stop", {static_cast<std::uint64_t>(i), 1}));
    const Diagnosis diagnosis = diagnose({&recording, 1}, options);
    for (const EffectEstimate& p : diagnosis.explanations.at(0).parameters)
      if (p.name == "wheel_slip.stop") right += p.estimate == world.truth.at("wheel_slip.stop");
  }
  EXPECT_EQ(right, worlds);
}

}  // namespace
}  // namespace rangecal
