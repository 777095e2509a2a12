// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/bookkeeping.hpp"

namespace rangecal::diagnosis {

/// A question about dependence, tails or spread of a channel whose values sit on a grid, or about that grid.
bool on_grid(const Bookkeeping& known, const Question& q);

/// What a battery found, by penalised gain, at most five, one per (channel, covariate).
std::vector<Question> findings(const Rows& rows, const Battery& battery, double alarm_rate);

}  // namespace rangecal::diagnosis
