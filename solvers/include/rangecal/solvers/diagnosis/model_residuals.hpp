// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"

namespace rangecal {

/// One reading beside what a model says of it.
struct ReadingResidual {
  int recording = 0;
  int reading = 0;  ///< index into Recording::readings, or ::pairs
  int stop = -1,
      landmark = -1;  ///< indices into Recording::stops, ::landmarks; -1: kind pairs, or no landmark
  int repeat = 0;     ///< within the cell (stop, landmark), in order of time
  int row = 0;        ///< line in the file (header = 1)
  double range_m = 0.0, bearing_rad = 0.0;  ///< as read
  double distance_m = 0.0;                  ///< true distance d under the model
  double range_residual_m = 0.0;            ///< y - delta y - f(d), delta y the model's effects
  double range_std_m = 0.0;                 ///< of one reading, as modelled
  double bearing_residual_rad = 0.0, bearing_std_rad = 0.0;  ///< 0 for kind pairs
  double corrected_m =
      0.0;  ///< the distance that the reading stands for: d + residual / f'(d), to first order
};

/// The readings in an order of their own: by recording, stop, landmark and time.
struct ModelResiduals {
  std::vector<ReadingResidual> readings;
  std::map<std::string, std::vector<double>> along;  ///< covariates asked for, one value per reading
};

/// Residuals of every reading under a calibration, its effects and, where given, a smooth model's changes
/// (one entry per recording, as in SimulationModel). `covariates`: names of docs/formats.md; a name that the
/// recordings lack is left out. Where the calibration has no stops the commanded ones stand in. Throws
/// InputError where it has no curve, or no place for a landmark that was read. Cost: linear in the readings.
ModelResiduals model_residuals(std::span<const Recording> recordings, const Calibration& calibration,
                               std::span<const std::string> covariates = {},
                               std::span<const AddedChange> added = {});

/// The recordings with the landmarks that a model reads behind their labels.
std::vector<Recording> relabelled(std::span<const Recording> recordings, const SimulationModel& model);

/// Where a calibration has a stop; the commanded pose where it has none.
Pose2 estimated_pose(std::span<const Recording> recordings, const Calibration& calibration, int recording,
                     int stop);
/// Where it has a landmark's axis [m]; nothing where it was not placed.
std::optional<Eigen::Vector2d> estimated_place(const Calibration& calibration, int recording,
                                               const std::string& landmark);

/// Bin of every value, as the diagnosis bins its residuals: 12 bins of equal shares, or one for each value
/// where there are few; -1 where a value is not finite. Cost: n log n.
std::vector<int> bins_of_equal_shares(const std::vector<double>& values);

}  // namespace rangecal
