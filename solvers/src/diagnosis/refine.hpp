// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the likelihood has steps or many peaks along the effect's parameters: small moves do not lead from one to another.
bool has_many_optima(const Effect& effect);

/// Looks for a better optimum of one member of a fit, where small moves do not lead:
///
///   a jump's distance             from all starts beside the other members fitted without it, and with places carried over the jump
///   a jump's distance, a sector   on a grid an eighth as wide as its starts
///   a landmark, a stop            every other one of a few labels, of many the one before and the one after, as long as that gains
///   a fast period                 a quarter of a peak's width at a time, from `geometry`: stops and landmarks as they are without
///                                 the member
void refine_member(const Rows& rows, const JointState& geometry, std::size_t member,
                   const RefitOptions& options, Fit& fit);

}  // namespace rangecal::diagnosis
