// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fleet/database.hpp"
#include "fleet/fleet_job.hpp"

namespace rangecal::app {

/// Population, posteriors and oddities from the units in the database, each made anew in one transaction: cheap beside
/// the units. Fills what the result says of them.
void fit_whole(Database& database, const FleetJob& job, FleetResult& result);

}  // namespace rangecal::app
