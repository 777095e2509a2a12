// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// Readings' changes of a smooth model without a name, one entry per reading in the order of the recording.
struct AddedChange {
  std::vector<double> range_m, bearing_rad, range_log_variance, bearing_log_variance;  ///< all empty: none
};

/// The model a diagnosis stands by, with everything it takes to simulate its recordings again.
struct SimulationModel {
  std::vector<Recording> recordings;            ///< who is read when, from where, with which covariates
  std::vector<std::vector<int>> landmark_read;  ///< per recording and reading: the landmark behind the label
  Calibration calibration;                      ///< curve, noise, landmarks, effects with their parameters
  std::vector<AddedChange> added;               ///< per recording
};

/// New recordings of the model: stops drawn from their prior, moved by the effects; readings from the curve, the noise
/// law and the effects, at the times and covariates of the layout. Readings that cannot be are left out: not positive,
/// or infinite, as of a disparity that is rounded to zero. The same seed gives the same recordings. Throws InputError
/// for an effect that is in no catalogue.
std::vector<Recording> simulate(const SimulationModel& model, std::uint64_t seed);

/// The object `simulation` of a diagnosis, and back. `file` names the source in messages of InputError.
std::string simulation_model_to_json(const SimulationModel& model);
SimulationModel simulation_model_from_json(const std::string& text, const std::string& file);

}  // namespace rangecal
