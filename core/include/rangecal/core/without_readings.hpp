// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

/// Takes the readings marked `out` (one mark a reading, in the order of the file) out of every column of a recording of either kind, and out
/// of its groups. Stops and landmarks stay. Cost: linear in the readings.
void leave_out_readings(const std::vector<char>& out, Recording& recording);

}  // namespace rangecal
