// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/json_fields.hpp"

namespace rangecal::app {

/// What a correction needs of a calibration of pairs, bit by bit, in the state of a stream.
struct SavedCalibration {
  Calibration calibration;
};
void fields(JsonFields& json, SavedCalibration& saved);

/// Of what corrects and what --watch holds readings against: the same from the same calibration, wherever it stands.
std::string fingerprint_of(const Calibration& calibration);

}  // namespace rangecal::app
