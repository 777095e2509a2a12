// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/noise_shapes.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/problems/landmarks/cell_order.hpp"

namespace rangecal {
namespace {

template <typename Robust>
Calibration shaped_calibration(const LandmarksJob& job, Method method, const Robust& robust) {
  Calibration result = calibration_from_fit(job, method, robust.fit);
  if (result.alpha.size() == 0) return result;
  const RobustShapes& shapes = robust.shapes;
  if (const auto range = shape_estimate(shapes.range, shapes.range_std))
    result.noise_shapes["range"] = *range;
  if (const auto bearing = shape_estimate(shapes.bearing, shapes.bearing_std))
    result.noise_shapes["bearing"] = *bearing;
  return result;
}

}  // namespace

std::string in_words(const ShapeEstimate& shape) {
  const auto found_in = [](const std::map<std::string, double>& all, const char* name) {
    const auto found = all.find(name);
    return found == all.end() ? 0.0 : found->second;
  };
  const auto value = [&](const char* name) { return found_in(shape.parameters, name); };
  if (shape.family == to_string(NoiseShape::student_t)) {
    const double std_dev = found_in(shape.std_dev, "nu");
    return fmt::format("student-t with nu = {:.3g}{}", value("nu"),
                       std_dev > 0.0 ? fmt::format(" +- {:.2g}", std_dev) : std::string());
  }
  if (value("outlier_share") < 1e-5) return shape.family + " without an outlier";
  if (shape.family == to_string(NoiseShape::one_sided))
    return fmt::format("one-sided: {:.3g} % of the readings {} by {:.3g} m on average",
                       100.0 * value("outlier_share"), value("outlier_mean") > 0.0 ? "late" : "early",
                       std::abs(value("outlier_mean")));
  return fmt::format("{}: {:.3g} % of the readings with {:.3g} times the spread", shape.family,
                     100.0 * value("outlier_share"), value("outlier_scale"));
}

Calibration calibration_from_robust(const LandmarksJob& job, const RobustJointFit& fit) {
  return shaped_calibration(job, Method::full, fit);
}

Calibration calibration_from_robust(const LandmarksJob& job, const RobustMarginalFit& fit) {
  Calibration result = shaped_calibration(job, Method::marginal, fit);
  result.sigma_s_upper95_m = fit.fit.sigma_s_upper95_m;
  return result;
}

namespace {

constexpr std::size_t most_listed = 10;
constexpr double rather_an_outlier = 0.5;  // probability; for Student's t: 3/4 of the weight is lost
constexpr double lost_weight = 0.75;

/// Counts the outliers and lists the ten that are farthest off.
void keep_gravest(std::vector<OutlierReading> all, Calibration& calibration) {
  calibration.outlier_count = static_cast<int>(all.size());
  std::stable_sort(all.begin(), all.end(), [](const OutlierReading& a, const OutlierReading& b) {
    return std::abs(a.sigmas) > std::abs(b.sigmas);
  });
  if (all.size() > most_listed) all.resize(most_listed);
  calibration.outliers = std::move(all);
}

const char* echo(double z) { return z > 0.0 ? "late echo" : "early echo"; }

/// Errors of row i against landmark l in spreads, range and bearing.
std::pair<double, double> errors_against(const JointProblem& rows, const JointState& state, std::size_t i,
                                         std::size_t l) {
  const Pose2& pose = state.stops[rows.cells.stop[i]];
  const Eigen::Vector2d sight = state.landmarks[l] - Eigen::Vector2d(pose.x_m, pose.y_m);
  const double d = sight.norm() - rows.landmark_radius_m[l], f = evaluate_polynomial(state.alpha, d);
  const double direction = std::atan2(sight.y(), sight.x()) - pose.heading_rad;
  return {(rows.cells.range_mean[i] - f) / state.noise.spread(d, f),
          wrap_angle(rows.cells.bearing_mean[i] - direction) / state.sigma_theta_rad};
}

std::string reason_of(const LandmarksJob& job, const JointState& state, std::size_t i, double range_z,
                      double bearing_z, bool range_off, bool bearing_off) {
  constexpr double close = 4.0;
  const JointProblem& rows = *job.rows;
  const Cells& c = rows.cells;
  const std::size_t own = static_cast<std::size_t>(c.landmark[i]);
  for (std::size_t l = 0; bearing_off && l < state.landmarks.size(); ++l) {
    if (l == own || rows.landmark_recording[l] != rows.landmark_recording[own]) continue;
    const auto [range, bearing] = errors_against(rows, state, i, l);
    if (std::abs(range) < close && std::abs(bearing) < close) return "label of " + job.landmark_labels[l];
  }
  if (range_off && !bearing_off) return echo(range_z);
  const double across = std::abs(bearing_z) * state.sigma_theta_rad * c.range_mean[i], radius = c.radius_m[i];
  if (radius > 0.0 && across > 0.5 * radius && across < 1.5 * radius) return "grazing";
  return "bearing";
}

}  // namespace

void list_outliers(const LandmarksJob& job, const RobustMarginalFit& fit, Calibration& calibration) {
  const RobustShapes& shapes = fit.shapes;
  const JointState& state = fit.fit.state;
  const ReadingErrors errors = reading_errors(*job.rows, state, shapes.range, shapes.bearing);
  const auto limit = [](const NoiseShapeParameters& shape) {
    return shape.shape == NoiseShape::student_t ? lost_weight : rather_an_outlier;
  };
  const double of_range = limit(shapes.range), of_bearing = limit(shapes.bearing);
  std::vector<OutlierReading> all;
  std::size_t i = 0;
  for (std::size_t recording = 0; recording < job.recordings.size(); ++recording) {
    const Readings& readings = job.recordings[recording].readings;
    for (const std::size_t r : cell_order(readings)) {
      if (i >= errors.range_z.size()) break;
      const bool range = errors.range_outlier[i] > of_range, bearing = errors.bearing_outlier[i] > of_bearing;
      const double range_z = errors.range_z[i], bearing_z = errors.bearing_z[i];
      if (range || bearing) {
        const bool by_range = range && (!bearing || std::abs(range_z) > std::abs(bearing_z));
        all.push_back({static_cast<int>(recording),
                       r < readings.row.size() ? readings.row[r] : static_cast<int>(r) + 1,
                       by_range ? "range" : "bearing", by_range ? range_z : bearing_z,
                       reason_of(job, state, i, range_z, bearing_z, range, bearing)});
      }
      ++i;
    }
  }
  keep_gravest(std::move(all), calibration);
}

void list_outliers(const std::vector<double>& z, const std::vector<double>& outlier,
                   const std::vector<PlacedReading>& places, Calibration& calibration) {
  const auto found = calibration.noise_shapes.find("range");
  if (found == calibration.noise_shapes.end()) return;
  const double limit =
      found->second.family == to_string(NoiseShape::student_t) ? lost_weight : rather_an_outlier;
  std::vector<OutlierReading> all;
  for (std::size_t i = 0; i < z.size() && i < places.size(); ++i)
    if (outlier[i] > limit) all.push_back({places[i].recording, places[i].row, "range", z[i], echo(z[i])});
  keep_gravest(std::move(all), calibration);
}

std::string tried_in_words(NoiseShape kept, const std::vector<std::pair<NoiseShape, double>>& tried) {
  std::string text;
  for (const auto& [shape, above] : tried)
    if (shape != kept) text += fmt::format("{}{} {:+.1f}", text.empty() ? "" : ", ", to_string(shape), above);
  return std::string(to_string(kept)) + (text.empty() ? "" : " (" + text + ")");
}

void report_shapes(CalibrationReport& report) {
  for (const Calibration& calibration : report.calibrations) {  // the last one asked for decides
    if (calibration.noise_shapes.empty()) continue;
    report.noise_shape.clear();
    for (const char* channel : {"range", "bearing"}) {
      const auto found = calibration.noise_shapes.find(channel);
      if (found == calibration.noise_shapes.end()) continue;
      const bool pairs = calibration.kind == RecordingKind::pairs;
      report.noise_shape +=
          fmt::format("{}{}{}", report.noise_shape.empty() ? "" : "; ",
                      pairs ? "" : fmt::format("of {}s ", channel), in_words(found->second));
    }
  }
  if (!report.noise_shape.empty())
    report.notes.push_back("noise is " + report.noise_shape +
                           "; a sigma is the spread of the readings that are no outliers");
}

}  // namespace rangecal
