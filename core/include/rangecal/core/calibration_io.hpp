// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

class JsonFields;
/// The members of `curve` (docs/formats.md), both ways.
void fields(JsonFields& json, CurveScale& scale);

/// Writes `rangecal-calibration/1` JSON (docs/formats.md): one object, or several under `methods`. Written to a temporary
/// and renamed, so that no file is left half-written. Throws InputError if the path cannot be written. `notes`, what is to be
/// known of the job, stand beside the calibrations where there are any; reading leaves them.
void save_calibrations(const std::vector<Calibration>& calibrations, const std::string& path,
                       const std::vector<std::string>& notes = {});
std::string calibrations_to_json(const std::vector<Calibration>& calibrations,
                                 const std::vector<std::string>& notes = {});

/// Reads what save_calibrations wrote. Throws InputError naming file and field.
std::vector<Calibration> load_calibrations(const std::string& path);

/// The calibration to use from a file: the only one, or of several the best of marginal, full, approximate,
/// closed-form that is usable.
Calibration load_calibration(const std::string& path);

}  // namespace rangecal
