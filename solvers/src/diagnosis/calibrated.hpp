// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "diagnosis/working.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal::diagnosis {

/// The effects of a calibration with their parameters. Throws InputError for an effect or parameter that is
/// in no catalogue, or is missing.
Model model_of(const Calibration& calibration);

/// Recordings under a calibration: the rows, and the point in the space of all unknowns that it stands for.
struct Calibrated {
  Rows rows;
  JointState state;
  Model model;
};

/// Stops and landmarks are found by recording and label; where the calibration has no stops, the commanded
/// ones stand in. Throws InputError where it has no curve, or no place for a landmark that was read.
Calibrated calibrated(std::span<const Recording> recordings, const Calibration& calibration);

}  // namespace rangecal::diagnosis
