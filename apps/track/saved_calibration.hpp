// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "rangecal/core/calibration.hpp"

namespace rangecal::app {

/// What a correction needs of a calibration of pairs, bit by bit, for the state of a stream; and back. The
/// second throws InputError or a JSON exception where the state is damaged.
nlohmann::ordered_json json_of(const Calibration& calibration);
Calibration calibration_in(const nlohmann::ordered_json& json);

/// Of what corrects and what --watch holds readings against: the same from the same calibration, wherever it stands.
std::string fingerprint_of(const Calibration& calibration);

}  // namespace rangecal::app
