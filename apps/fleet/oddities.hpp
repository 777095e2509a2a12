// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

#include "fleet/database.hpp"
#include "fleet/fleet_job.hpp"

namespace rangecal::app {

/// Where theta = (alpha_0 .. alpha_n, log sigma) differs from the others': `difference` from the population's mean [m^(1-i),
/// and of the logarithm], and its t (FleetJudge). The parameter furthest off, and those beyond three standard deviations,
/// furthest first: "calibration differs from the population's: alpha_0 +72 mm (+14.1 sd), sigma -12 % (-3.3 sd)".
std::string difference_in_words(const Eigen::VectorXd& difference, const Eigen::VectorXd& t);

/// What the diagnosis says of the oddest units, put behind what is said of each oddity already. Of pairs unlike
/// the others: what sets them apart from the population's curve, which may lie anywhere in the population's scatter; where it
/// says nothing there, and of all others: what their own curve leaves out, or that nothing is found. Fills result.odd.
void explain_oddities(Database& database, const FleetJob& job, FleetResult& result);

}  // namespace rangecal::app
