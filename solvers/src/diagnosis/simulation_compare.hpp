// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// The recording minus its simulation, reading by reading: with ^ the seed model fitted to the simulation,
///   y = y_rec - (y_sim - f(d^)),   bearing = b_rec - (b_sim - theta^),   commanded stops = the simulation's
///   fitted ones.
/// What both share cancels to first order; landmarks stay free, alpha is the simulation's exactly, and the
/// spreads of readings and stops are sqrt(2) of one run's. Readings without a partner of the same stop,
/// landmark and rank are left out. None where the layouts differ: other stops, or commanded poses more than 3
/// sigma (or 1 cm) apart.
std::optional<Recording> paired(const Recording& recording, const Recording& simulation,
                                const Rows& simulation_rows, const JointState& simulation_state,
                                int first_stop, int first_landmark);

/// One model accounts for both: the effects that are found in the recordings alone, fitted to recordings and simulation at once,
/// leave nothing in either, and sharing the parameters costs no more than chance,
///   2 (nll_both - nll_recordings - nll_simulation) ~ chi^2 of as many degrees as there are parameters (Wilks).
/// The difference reading by reading cannot say so of noise, which does not cancel, nor of an effect that varies over the
/// millimetres by which the stops of two runs differ.
bool one_model_accounts_for(std::span<const Recording> recordings, std::span<const Recording> simulation,
                            const DiagnoseOptions& options);

/// Where a seed model of the recordings' own leaves nothing, the simulation differs in the curve alone: those
/// of range_offset, range_scale and laser_pointing that say it best, at the price of 6.5 nats each. Empty
/// otherwise.
std::vector<std::string> curve_mismatch(const Rows& rows, const Bookkeeping& known, const SearchResult& found,
                                        const DiagnoseOptions& options);

/// Adds a finding where the recordings' noise level differs from the simulation's by more than 3.5 standard
/// deviations of both; a diagnosis without other findings becomes unexplained by it. Its p-value is that of
/// the normal, two-sided, times the number of levels (range, bearing) that both have: Bonferroni.
void compare_noise(const Calibration& simulation, const Calibration& own, Diagnosis& result);

}  // namespace rangecal::diagnosis
