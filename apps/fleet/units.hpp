// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <exception>
#include <functional>
#include <optional>
#include <string>

#include "fleet/database.hpp"
#include "fleet/fingerprint.hpp"
#include "fleet/fleet_job.hpp"

namespace rangecal::app {

/// What is found out about one unit from its own readings.
struct Unit {
  std::string name;
  Calibration calibration;
  UnitMisfit misfit;
  std::optional<UnitSummary> summary;
  Fingerprint fingerprint;
  std::string notes;  ///< of the reader: what it left out or could not ask, one by line
};

/// Below so many the likelihood of a unit is not taken for a normal one.
constexpr int readings_for_own_fit(int order) { return 10 * (order + 2); }

/// Reads and fits one recording. What cannot be read, or throws anything else on the way, is a failed outcome with its
/// reason, so that one unit of thousands does not end the run.
Unit fit_unit(const std::string& name, const std::string& place, const FleetJob& job);
/// The same of what `fit` finds out.
Unit fit_unit(const std::string& name, const std::function<void(Unit&)>& fit);

/// In words for `units.reason`: wrong input says it itself.
std::string reason_of(const std::exception& error);

/// The noise shape of a calibration's ranges as `units.noise_shape` has it: a JSON object of family and parameters; empty for
/// the Gaussian.
std::string shape_to_json(const Calibration& calibration);
/// Throws InputError for a text that is none.
NoiseShapeParameters shape_from_json(const std::string& text);

/// The units joined with their posteriors, as CSV.
void write_csv(Database& database, const std::string& path);

}  // namespace rangecal::app
