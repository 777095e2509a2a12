// SPDX-License-Identifier: BSD-3-Clause
// The scene as data: outlines are polygons, so that a circle of 6 cm is one at every zoom.
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "fit_view.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::report {
namespace {

struct Box {
  double left = 1e300, right = -1e300, bottom = 1e300, top = -1e300;
  void hold(double x, double y) {
    left = std::min(left, x);
    right = std::max(right, x);
    bottom = std::min(bottom, y);
    top = std::max(top, y);
  }
};

/// The points centre + factor (cos, sin) as rows of one closed line.
void add_outline(Json& rows, int recording, const std::string& what, const std::string& shape,
                 const Eigen::Vector2d& centre, const Eigen::Matrix2d& factor) {
  constexpr int corners = 36;
  for (int i = 0; i <= corners; ++i) {
    const double angle = 2.0 * std::numbers::pi * i / corners;
    const Eigen::Vector2d at = centre + factor * Eigen::Vector2d(std::cos(angle), std::sin(angle));
    rows.push_back({{"recording", recording},
                    {"what", what},
                    {"shape", shape},
                    {"at", i},
                    {"x", number(at.x())},
                    {"y", number(at.y())}});
  }
}

Eigen::Matrix2d factor_of(const Eigen::Matrix2d& covariance) {
  return radius95 * Eigen::LLT<Eigen::Matrix2d>(covariance).matrixL().toDenseMatrix();
}

struct SceneData {
  Json stops = Json::array(), landmarks = Json::array(), outlines = Json::array();
  Json ellipses = Json::array(), prior = Json::array();  ///< of the stops' moves [mm]
  double moved_mm = 0.0;
  std::vector<Box> boxes;
};

void add_stops(const FitView& view, int index, std::size_t first, SceneData& data) {
  const Recording& recording = view.recordings[static_cast<std::size_t>(index)];
  double largest_sigma = 0.0;
  for (std::size_t k = 0; k < recording.stops.size(); ++k) {
    const Stop& stop = recording.stops[k];
    const Pose2& pose =
        view.calibration.stops.empty() ? stop.commanded : view.calibration.stops[first + k].pose;
    const double dx = 1e3 * (pose.x_m - stop.commanded.x_m), dy = 1e3 * (pose.y_m - stop.commanded.y_m);
    data.stops.push_back({{"recording", index},
                          {"stop", stop.label},
                          {"x", number(pose.x_m)},
                          {"y", number(pose.y_m)},
                          {"x_commanded", number(stop.commanded.x_m)},
                          {"y_commanded", number(stop.commanded.y_m)},
                          {"dx_mm", number(dx)},
                          {"dy_mm", number(dy)}});
    data.boxes.back().hold(pose.x_m, pose.y_m);
    data.boxes.back().hold(stop.commanded.x_m, stop.commanded.y_m);
    data.moved_mm = std::max({data.moved_mm, std::abs(dx), std::abs(dy)});
    largest_sigma = std::max(largest_sigma, sigma_xy_of(recording, stop));
    if (first + k >= view.covariance.stops.size() || !view.covariance.stops[first + k]) continue;
    const Eigen::Matrix2d factor = factor_of(*view.covariance.stops[first + k]);
    const std::string shape = fmt::format("stop {} {}", index, stop.label);
    add_outline(data.outlines, index, "stop estimated", shape, {pose.x_m, pose.y_m}, factor);
    add_outline(data.ellipses, index, "", shape, {dx, dy}, 1e3 * factor);
    data.moved_mm = std::max(data.moved_mm, std::hypot(dx, dy) + 1e3 * factor.rowwise().norm().maxCoeff());
  }
  if (recording.stop_error == StopErrorModel::independent && !recording.estimate_sigma_xy &&
      largest_sigma > 0.0) {
    add_outline(data.prior, index, "", fmt::format("prior {}", index), Eigen::Vector2d::Zero(),
                1e3 * radius95 * largest_sigma * Eigen::Matrix2d::Identity());
    data.moved_mm = std::max(data.moved_mm, 1e3 * radius95 * largest_sigma);
  }
}

void add_landmarks(const FitView& view, int index, std::size_t first, SceneData& data) {
  const Recording& recording = view.recordings[static_cast<std::size_t>(index)];
  for (std::size_t l = 0; l < recording.landmarks.size(); ++l) {
    const Landmark& landmark = recording.landmarks[l];
    const auto at = std::find_if(
        view.calibration.landmarks.begin(), view.calibration.landmarks.end(),
        [&](const LandmarkEstimate& e) { return e.recording == index && e.label == landmark.label; });
    if (at == view.calibration.landmarks.end()) continue;
    std::optional<Eigen::Matrix2d> covariance = at->covariance;
    if (!covariance && first + l < view.covariance.landmarks.size())
      covariance = view.covariance.landmarks[first + l];
    data.landmarks.push_back(
        {{"recording", index},
         {"landmark", landmark.label},
         {"x", number(at->position_m.x())},
         {"y", number(at->position_m.y())},
         {"y_label", number(at->position_m.y() + landmark.radius_m + 0.03)},
         {"radius_mm", number(1e3 * landmark.radius_m)},
         {"std_mm", covariance ? number(1e3 * std::sqrt(covariance->trace())) : Json("unknown")}});
    const std::string shape = fmt::format("{} {}", index, landmark.label);
    if (landmark.radius_m > 0.0)
      add_outline(data.outlines, index, "landmark", "radius " + shape, at->position_m,
                  landmark.radius_m * Eigen::Matrix2d::Identity());
    if (covariance)
      add_outline(data.outlines, index, "landmark", "ellipse " + shape, at->position_m,
                  factor_of(*covariance));
    const double reach = landmark.radius_m + 0.1;
    data.boxes.back().hold(at->position_m.x() - reach, at->position_m.y() - reach);
    data.boxes.back().hold(at->position_m.x() + reach, at->position_m.y() + reach);
  }
}

/// Widens the box to the readings as they are drawn, all but the outermost half percent on each side.
void hold_readings(const FitView& view, int index, Box& box) {
  std::vector<double> x, y;
  for (std::size_t i : shown(view.residuals.readings.size())) {
    const ReadingResidual& reading = view.residuals.readings[i];
    const std::optional<ReadingPlaces> places =
        reading.recording == index ? places_of(view, reading) : std::nullopt;
    if (!places) continue;
    x.insert(x.end(), {places->raw.x(), places->corrected.x()});
    y.insert(y.end(), {places->raw.y(), places->corrected.y()});
  }
  if (x.empty()) return;
  const Limits across = limits_of(x), up = limits_of(y);
  box.hold(across.low, up.low);
  box.hold(across.high, up.high);
}

SceneData scene_of(const FitView& view) {
  SceneData data;
  std::size_t stops = 0, landmarks = 0;
  for (std::size_t r = 0; r < view.recordings.size(); ++r) {
    const int index = static_cast<int>(r);
    data.boxes.emplace_back();
    add_stops(view, index, stops, data);
    add_landmarks(view, index, landmarks, data);
    hold_readings(view, index, data.boxes.back());
    stops += view.recordings[r].stops.size();
    landmarks += view.recordings[r].landmarks.size();
  }
  return data;
}

Chart scene_chart(const FitView& view, std::size_t r, const Box& box) {
  return {fmt::format("scene-{}", r + 1),
          "scene",
          {{"recording", r},
           {"middle_x", 0.5 * (box.left + box.right)},
           {"middle_y", 0.5 * (box.bottom + box.top)},
           {"half_x", 0.54 * (box.right - box.left)},
           {"half_y", 0.54 * (box.top - box.bottom)}},
          view.recordings.size() == 1 ? "Stops, landmarks and readings" : fmt::format("Recording {}", r + 1),
          "Circles are the landmarks' radii, ellipses hold 95 %. Each reading is drawn from its estimated "
          "stop to where it says the landmark's axis is, as read and as the model corrects it. " +
              shown_in_words(view.residuals.readings.size()),
          "tall"};
}

Chart around_chart(const FitView& view) {
  std::vector<double> away;
  for (const ReadingResidual& x : view.residuals.readings) {
    away.push_back(1e3 * std::abs(x.range_m - x.distance_m));
    away.push_back(1e3 * x.distance_m * std::abs(x.bearing_residual_rad));
  }
  return {"around",
          "around",
          {{"half", limits_of(away).high}},
          "Readings around their landmarks",
          "Where each reading puts the landmark's axis, seen from the estimated stop.",
          "plot"};
}

Chart moves_chart(const SceneData& data) {
  return {
      "stops",
      "stops",
      {{"half", 1.05 * data.moved_mm}},
      "How far each stop was moved from its commanded place",
      "Ellipses hold 95 %, the parameters of effects held; the dashed circle holds 95 % of the stops under "
      "the stated sigma_xy.",
      "plot"};
}

}  // namespace

void add_scene(Page& page, const FitView& view) {
  if (view.calibration.kind == RecordingKind::pairs) return;
  const SceneData data = scene_of(view);
  page.section("The scene");
  page.dataset("stops", data.stops);
  page.dataset("landmarks", data.landmarks);
  page.dataset("outlines", data.outlines);
  page.dataset("stop_ellipses", data.ellipses);
  page.dataset("stop_prior", data.prior);
  constexpr std::size_t most = 4;
  for (std::size_t r = 0; r < std::min(most, view.recordings.size()); ++r)
    page.charts({scene_chart(view, r, data.boxes[r])});
  if (view.recordings.size() > most)
    page.paragraph(
        fmt::format("The scenes of {} more recordings are not drawn.", view.recordings.size() - most));
  std::vector<Chart> charts{around_chart(view)};
  if (data.moved_mm > 0.0) charts.push_back(moves_chart(data));
  page.charts(charts);
}

}  // namespace rangecal::report
