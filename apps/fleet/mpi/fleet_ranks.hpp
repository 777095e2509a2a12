// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "fleet/command.hpp"

namespace rangecal::app {

/// `fleet` under mpirun, called on every rank: each fits every size-th unit into a file of its own, OUTPUT.RANK-of-SIZE, rank
/// 0 takes these in, does the rest and removes them. After a kill the same number of ranks goes on in them. Where OUTPUT
/// stands already and no such file beside it, rank 0 goes on in it alone. The rows are those of one process. Returns the exit
/// code, the same on every rank but for what rank 0 could not deliver.
int run_fleet_ranks(FleetCommand& given, int rank, int size);

}  // namespace rangecal::app
