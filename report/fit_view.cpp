// SPDX-License-Identifier: BSD-3-Clause
#include "fit_view.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>

namespace rangecal::report {
namespace {

constexpr std::size_t most_readings = 4000;

std::size_t stride_of(std::size_t readings) { return (readings + most_readings - 1) / most_readings; }

}  // namespace

FitView view_of(std::vector<Recording> recordings, const Calibration& calibration,
                std::span<const std::string> covariates, std::span<const AddedChange> added) {
  FitView view;
  view.residuals = model_residuals(recordings, calibration, covariates, added);
  view.covariance = scene_covariance(recordings, calibration);
  view.recordings = std::move(recordings);
  view.calibration = calibration;
  return view;
}

std::vector<std::size_t> shown(std::size_t readings) {
  std::vector<std::size_t> indices;
  const std::size_t stride = std::max<std::size_t>(1, stride_of(readings));
  for (std::size_t i = 0; i < readings; i += stride) indices.push_back(i);
  return indices;
}

std::string shown_in_words(std::size_t readings) {
  const std::size_t stride = stride_of(readings);
  if (stride < 2) return {};
  return fmt::format("One in {} of {} readings is drawn; bins and curves are of all.", stride, readings);
}

void name_reading(const FitView& view, const ReadingResidual& reading, Json& row) {
  const Recording& recording = view.recordings[static_cast<std::size_t>(reading.recording)];
  const auto label = [&](const auto& list, int index) {
    return index < 0 ? std::string("–") : list[static_cast<std::size_t>(index)].label;
  };
  row["recording"] = reading.recording;
  row["stop"] = label(recording.stops, reading.stop);
  row["landmark"] = label(recording.landmarks, reading.landmark);
  row["row"] = reading.row;
}

Limits limits_of(std::vector<double> values) {
  std::erase_if(values, [](double v) { return !std::isfinite(v); });
  if (values.empty()) return {};
  std::sort(values.begin(), values.end());
  const double last = static_cast<double>(values.size()) - 1.0;
  const double low = values[static_cast<std::size_t>(std::lround(0.005 * last))];
  const double high = values[static_cast<std::size_t>(std::lround(0.995 * last))];
  const double margin = std::max(0.06 * (high - low), 1e-9 + 1e-3 * std::abs(high));
  return {low - margin, high + margin};
}

std::optional<ReadingPlaces> places_of(const FitView& view, const ReadingResidual& x) {
  if (x.stop < 0) return std::nullopt;
  const Recording& recording = view.recordings[static_cast<std::size_t>(x.recording)];
  const Landmark& landmark = recording.landmarks[static_cast<std::size_t>(x.landmark)];
  const auto axis = estimated_place(view.calibration, x.recording, landmark.label);
  if (!axis) return std::nullopt;
  const Pose2 stop = estimated_pose(view.recordings, view.calibration, x.recording, x.stop);
  const Eigen::Vector2d from(stop.x_m, stop.y_m), sight = *axis - from;
  const auto place = [&](double range, double direction) -> Eigen::Vector2d {
    return from + (range + landmark.radius_m) * Eigen::Vector2d(std::cos(direction), std::sin(direction));
  };
  return ReadingPlaces{from, *axis, place(x.range_m, stop.heading_rad + x.bearing_rad),
                       place(x.corrected_m, std::atan2(sight.y(), sight.x()) + x.bearing_residual_rad)};
}

void add_readings(Page& page, const FitView& view) {
  Json rows = Json::array();
  for (std::size_t i : shown(view.residuals.readings.size())) {
    const ReadingResidual& x = view.residuals.readings[i];
    Json row;
    name_reading(view, x, row);
    row["read"] = number(x.range_m);
    row["distance"] = number(x.distance_m);
    row["corrected"] = number(x.corrected_m);
    row["excess"] = number(1e3 * (x.range_m - x.distance_m));
    row["size"] = number(1e3 * std::abs(x.range_residual_m));
    if (const std::optional<ReadingPlaces> places = places_of(view, x)) {
      const Eigen::Vector2d sight = (places->axis - places->stop).normalized();
      const Eigen::Vector2d across(-sight.y(), sight.x());
      const auto put = [&](const std::string& how, const Eigen::Vector2d& at) {
        row["x_" + how] = number(at.x());
        row["y_" + how] = number(at.y());
        row["along_" + how] = number(1e3 * (at - places->axis).dot(sight));
        row["across_" + how] = number(1e3 * (at - places->axis).dot(across));
      };
      put("raw", places->raw);
      put("corrected", places->corrected);
    }
    rows.push_back(std::move(row));
  }
  page.dataset("readings", std::move(rows));
}

}  // namespace rangecal::report
