// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

/// A sentence where readings and distances differ by more than a factor of twenty, as they do when a file is
/// in millimetres: any factor fits a polynomial, so nothing else would say so. Empty otherwise.
std::string unit_doubt(const Calibration& calibration);

}  // namespace rangecal
