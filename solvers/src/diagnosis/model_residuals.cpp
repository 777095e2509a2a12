// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/model_residuals.hpp"

#include <algorithm>
#include <cmath>

#include "diagnosis/calibrated.hpp"
#include "diagnosis/residual_bins.hpp"

namespace rangecal {
namespace {

using namespace diagnosis;

double entry(const std::vector<double>& values, std::size_t i) { return values.empty() ? 0.0 : values[i]; }

}  // namespace

ModelResiduals model_residuals(std::span<const Recording> recordings, const Calibration& calibration,
                               std::span<const std::string> covariates, std::span<const AddedChange> added) {
  const Calibrated fit = calibrated(recordings, calibration);
  const CellGeometry geometry = cell_geometry(fit.rows, fit.state);
  const RowResiduals residuals = row_residuals(fit.rows, fit.model, fit.state);
  ModelResiduals result;
  result.readings.reserve(fit.rows.size());
  for (std::size_t r = 0, row = 0; r < recordings.size(); ++r) {
    const Recording& recording = recordings[r];
    const AddedChange none, &smooth = r < added.size() ? added[r] : none;
    for (const std::size_t i : row_order(recording)) {
      const int cell = fit.rows.cell[row];
      const Eigen::Index at = static_cast<Eigen::Index>(row);
      ReadingResidual x;
      x.recording = static_cast<int>(r);
      x.reading = static_cast<int>(i);
      if (!fit.rows.pairs) {
        x.stop = recording.readings.stop[i];
        x.landmark = recording.readings.landmark[i];
        x.bearing_residual_rad = residuals.bearing[at] - entry(smooth.bearing_rad, i);
        x.bearing_std_rad =
            std::sqrt(residuals.bearing_variance[at] * std::exp(entry(smooth.bearing_log_variance, i)));
      } else if (!recording.pairs.landmark.empty()) {
        x.landmark = recording.pairs.landmark[i];
      }
      x.repeat = fit.rows.repeat[row];
      x.row = fit.rows.file_row[row];
      x.range_m = fit.rows.range_m[row];
      x.bearing_rad = fit.rows.bearing_rad[row];
      x.distance_m = geometry.d[cell];
      x.range_residual_m = residuals.range[at] - entry(smooth.range_m, i);
      x.range_std_m = std::sqrt(residuals.range_variance[at] * std::exp(entry(smooth.range_log_variance, i)));
      x.corrected_m = x.distance_m + x.range_residual_m / geometry.slope[cell];
      result.readings.push_back(x);
      ++row;
    }
  }
  for (const std::string& name : covariates)
    if (const auto values = covariate_values(fit.rows, geometry, name))
      result.along[name].assign(values->begin(), values->end());
  return result;
}

std::vector<Recording> relabelled(std::span<const Recording> recordings, const SimulationModel& model) {
  std::vector<Recording> result(recordings.begin(), recordings.end());
  for (std::size_t r = 0; r < result.size() && r < model.landmark_read.size(); ++r)
    if (result[r].readings.landmark.size() == model.landmark_read[r].size())
      result[r].readings.landmark = model.landmark_read[r];
  return result;
}

Pose2 estimated_pose(std::span<const Recording> recordings, const Calibration& calibration, int recording,
                     int stop) {
  if (calibration.stops.empty())
    return recordings[static_cast<std::size_t>(recording)].stops[static_cast<std::size_t>(stop)].commanded;
  std::size_t k = static_cast<std::size_t>(stop);
  for (int r = 0; r < recording; ++r) k += recordings[static_cast<std::size_t>(r)].stops.size();
  return calibration.stops[k].pose;
}

std::optional<Eigen::Vector2d> estimated_place(const Calibration& calibration, int recording,
                                               const std::string& landmark) {
  for (const LandmarkEstimate& estimate : calibration.landmarks)
    if (estimate.recording == recording && estimate.label == landmark) return estimate.position_m;
  return std::nullopt;
}

std::vector<int> bins_of_equal_shares(const std::vector<double>& values) {
  return bins_of(Eigen::Map<const Eigen::VectorXd>(values.data(), static_cast<Eigen::Index>(values.size())));
}

}  // namespace rangecal
