// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "page.hpp"
#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/diagnosis/model_residuals.hpp"
#include "rangecal/solvers/diagnosis/scene_covariance.hpp"

namespace rangecal::report {

/// A fitted model over its recordings, as the charts show it.
struct FitView {
  std::vector<Recording> recordings;  ///< with the labels that the model reads
  Calibration calibration;
  ModelResiduals residuals;
  SceneCovariance covariance;
};
FitView view_of(std::vector<Recording> recordings, const Calibration& calibration,
                std::span<const std::string> covariates = {}, std::span<const AddedChange> added = {});

/// Which readings a chart shows: all, or every k-th so that a page stays light.
std::vector<std::size_t> shown(std::size_t readings);
/// "Every 4th of 16000 readings is drawn; bins and curves are of all." Empty where all are.
std::string shown_in_words(std::size_t readings);

/// What a hover tells of a reading: stop, landmark, file row.
void name_reading(const FitView& view, const ReadingResidual& reading, Json& row);

/// Where a reading puts its landmark's axis as seen from its estimated stop [m]: as read, and as the model corrects it.
struct ReadingPlaces {
  Eigen::Vector2d stop, axis;  ///< estimated
  Eigen::Vector2d raw, corrected;
};
/// Nothing for a reading of pairs.
std::optional<ReadingPlaces> places_of(const FitView& view, const ReadingResidual& reading);

/// The span of the middle 99 % of the values with a margin; 0 to 1 for none.
struct Limits {
  double low = 0.0, high = 1.0;
};
Limits limits_of(std::vector<double> values);

/// The rows that the scene, the curve and the noise chart share: dataset "readings".
void add_readings(Page& page, const FitView& view);

/// Stops commanded and estimated with 95 % ellipses, landmarks with radii, readings raw and corrected; and
/// how far each stop moved. Nothing for pairs.
void add_scene(Page& page, const FitView& view);

/// f(d) - d with its 95 % band over the readings, one per calibration, and the scores of the orders where
/// any.
struct NamedCurve {
  std::string name, colour;
  const Calibration* calibration;
};
void add_curves(Page& page, const std::vector<NamedCurve>& curves, const std::vector<ModelScore>& scores);

/// The spread of the residuals over the distance beside the noise law.
void add_noise(Page& page, const FitView& view);

/// What the charts of residuals show, above them.
inline constexpr const char* residuals_lead =
    "Grey: one reading each, its calibration taken away. Colour: means of bins, with the 95 % bands that the fitted noise gives "
    "the mean of so many independent readings: one bin in twenty lies outside by chance.";
/// Residuals of one model along range and direction, where there is no finding to look at.
void add_plain_residuals(Page& page, const FitView& view);

}  // namespace rangecal::report
