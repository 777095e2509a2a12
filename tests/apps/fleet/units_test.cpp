// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/units.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include <new>
#include <stdexcept>

#include "rangecal/core/errors.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal::app {
namespace {

using ::testing::HasSubstr;

/// What is kept of a unit whose fit throws when half of it is done.
template <typename Error>
Unit unit_that_throws(const Error& error) {
  return fit_unit("u7", [&](Unit& unit) {
    unit.fingerprint = {1, 2};
    unit.calibration.outcome = Outcome::converged;
    unit.calibration.alpha = Eigen::Vector2d(0.1, 0.9);
    unit.calibration.counts.read = unit.calibration.counts.used = 60;
    unit.misfit.tail_p = 1e-9;
    unit.summary.emplace();
    throw error;
  });
}

TEST(FleetUnits, WhateverIsThrownEndsOneUnitOnly) {
  const std::pair<Unit, std::string> cases[] = {
      {unit_that_throws(InputError("pairs.csv", 3, "true_m", "is empty")),
       "pairs.csv, row 3, column 'true_m': is empty"},
      {unit_that_throws(std::domain_error("tgamma: the argument is 0")),
       "internal error: tgamma: the argument is 0"},
      {unit_that_throws(std::bad_alloc()), "there is not enough memory for it"}};
  for (const auto& [unit, reason] : cases) {
    SCOPED_TRACE(reason);
    EXPECT_EQ(unit.name, "u7");
    EXPECT_EQ(unit.calibration.outcome, Outcome::failed);
    EXPECT_EQ(unit.calibration.reason, reason);
    EXPECT_EQ(unit.calibration.counts.read, 0);  // counts as one that cannot be read, and is tried again
    EXPECT_EQ(unit.calibration.alpha.size(), 0);
    EXPECT_FALSE(unit.summary);
    EXPECT_EQ(unit.misfit.tail_p, 1.0);
    EXPECT_EQ(unit.fingerprint.stamp, 1);
    EXPECT_EQ(unit.fingerprint.contents, 2);
  }
}

TEST(FleetUnits, AFolderWithoutARecordingIsNamed) {
  const test::TemporaryFolder folder;
  const Unit unit = fit_unit("none", folder.file("none"), FleetJob());
  EXPECT_EQ(unit.calibration.outcome, Outcome::failed);
  EXPECT_THAT(unit.calibration.reason, HasSubstr("none"));
}

}  // namespace
}  // namespace rangecal::app
