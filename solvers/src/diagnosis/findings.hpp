// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/bookkeeping.hpp"

namespace rangecal::diagnosis {

/// True if the readings of the channel, of whose spread, tails or dependence this is, sit on a grid: they are neither normal nor
/// independent.
bool channel_is_on_grid(const Bookkeeping& known, const std::string& channel);

/// A question about dependence, tails or spread of a channel whose values sit on a grid, or about that grid.
bool on_grid(const Bookkeeping& known, const Question& q);

/// Nats that a fit of the question's shape would gain: half its likelihood ratio.
double gain_of(const Rows& rows, const Question& q);

/// Nats that one parameter of a curve costs: half the logarithm of the cell means of both channels (Schwarz 1978).
double price_of_curve_parameter(const Rows& rows);

/// What a battery found, by penalised gain, at most five, one per (channel, covariate). Where an effect of the catalogue
/// alone raises the alarm, and no shape does, that is the finding.
std::vector<Question> findings(const Rows& rows, const Battery& battery, double alarm_rate);

}  // namespace rangecal::diagnosis
