// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/separation.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <span>
#include <string>
#include <vector>

#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "solvers/diagnosis/select/made_worlds.hpp"

namespace rangecal::diagnosis {
namespace {

/// The stops of the turning design scatter 2.7 cm more than stated.
Recording scattered() {
  return testing::recording_with({{"stop_effect", 0.027}}, "Separation.OfTheStopsSpread");
}

TEST(Separation, OfTheSpreadOfStopsIsNothingWhereAllStateTheSame) {
  // sigma_xy k = sqrt(sigma_xy^2 + sigma_p^2): one and the same law where every stop states the same sigma_xy.
  Recording recording = scattered();
  const auto apart = [&] {
    const testing::SeedFit seed(recording);
    double sigma = 0.0;
    for (const Stop& stop : recording.stops)
      sigma += stop.sigma_xy_m.value_or(recording.sigma_xy_m) / static_cast<double>(recording.stops.size());
    const double extra = 0.027, factor = std::hypot(sigma, extra) / sigma;
    const Model added{{find_effect("stop_effect"), Eigen::Vector2d(extra, 0.0)}};
    const Model scaled{{find_effect("stated_sigma"), Eigen::VectorXd::Constant(1, std::log(factor))}};
    return separation(seed.rows, seed.fit.state, added, scaled, {});
  };
  EXPECT_NEAR(apart(), 0.0, 1e-9);
  for (std::size_t k = 0; k < recording.stops.size(); ++k)
    recording.stops[k].sigma_xy_m = (k % 2 ? 4.0 : 0.25) * recording.sigma_xy_m;
  EXPECT_GT(apart(), 7.0);  // of stops that state different spreads the two say different things
}

TEST(Separation, StopsThatScatterMoreThanStatedHaveBothNames) {
  const Recording recording = scattered();
  const Diagnosis diagnosis = diagnose(std::span(&recording, 1), {});
  ASSERT_EQ(diagnosis.verdict, Verdict::explained);
  ASSERT_FALSE(diagnosis.explanations.empty());
  std::vector<std::vector<std::string>> sets = diagnosis.explanations[0].indistinguishable_from;
  sets.push_back(diagnosis.final_effects);
  for (const char* name : {"stop_effect", "stated_sigma"})
    EXPECT_EQ(std::count(sets.begin(), sets.end(), std::vector<std::string>{name}), 1) << name;
}

}  // namespace
}  // namespace rangecal::diagnosis
