// SPDX-License-Identifier: BSD-3-Clause
#include "findings_beyond_means.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <map>
#include <set>
#include <tuple>

#include "diagnosis_words.hpp"
#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::report {
namespace {

using app::ends_with;

double standardised(const ReadingResidual& x, bool bearing) {
  return bearing ? x.bearing_residual_rad / x.bearing_std_rad : x.range_residual_m / x.range_std_m;
}

struct Model {
  const FitView* view;
  const char *name, *title, *colour;
};
std::vector<Model> models_of(const FitView& before, const FitView* after) {
  std::vector<Model> models{{&before, "before", "Before: the seed model", "var(--before)"}};
  if (after) models.push_back({after, "after", "After: the completed model", "var(--after)"});
  return models;
}

/// A standardised value and the reading that hover names.
struct Named {
  double value;
  const ReadingResidual* reading;
};

std::vector<Named> each_reading(const FitView& view, bool bearing) {
  std::vector<Named> values;
  for (const ReadingResidual& x : view.residuals.readings) values.push_back({standardised(x, bearing), &x});
  return values;
}

/// Means of the cells, by the spread that independent readings give them.
std::vector<Named> each_cell(const FitView& view, bool bearing) {
  struct Sum {
    double value = 0.0;
    int count = 0;
    const ReadingResidual* first = nullptr;
  };
  std::map<std::tuple<int, int, int>, Sum> cells;
  for (const ReadingResidual& x : view.residuals.readings) {
    if (x.stop < 0) return {};
    Sum& sum = cells[{x.recording, x.stop, x.landmark}];
    if (!sum.first) sum.first = &x;
    sum.value += standardised(x, bearing);
    ++sum.count;
  }
  std::vector<Named> values;
  for (const auto& [key, sum] : cells) values.push_back({sum.value / std::sqrt(sum.count), sum.first});
  return values;
}

/// Sorted values beside the quantiles of the normal law; of many, the middle is thinned.
Json quantile_rows(const FitView& view, std::vector<Named> values, Limits& limits) {
  std::sort(values.begin(), values.end(), [](const Named& a, const Named& b) { return a.value < b.value; });
  constexpr std::size_t tail = 60, middle = 200;
  const std::size_t count = values.size(), stride = std::max<std::size_t>(1, count / middle);
  Json rows = Json::array();
  for (std::size_t i = 0; i < count; ++i) {
    if (i >= tail && i + tail < count && i % stride != 0) continue;
    const double value = values[i].value;
    Json row;
    name_reading(view, *values[i].reading, row);
    row["normal"] = number(normal_quantile((static_cast<double>(i) + 0.5) / static_cast<double>(count)));
    row["value"] = number(value);
    limits = {std::min(limits.low, value), std::max(limits.high, value)};
    rows.push_back(std::move(row));
  }
  return rows;
}

std::vector<Chart> quantiles(Page& page, const std::string& id, bool bearing, bool of_cells,
                             const std::vector<Model>& models) {
  Limits limits{-3.5, 3.5};
  for (const Model& model : models) {
    std::vector<Named> values =
        of_cells ? each_cell(*model.view, bearing) : each_reading(*model.view, bearing);
    if (values.empty()) return {};
    page.dataset(fmt::format("{}-points-{}", id, model.name),
                 quantile_rows(*model.view, std::move(values), limits));
  }
  std::vector<Chart> charts;
  for (const Model& model : models)
    charts.push_back({fmt::format("{}-{}", id, model.name),
                      "quantiles",
                      {{"points", fmt::format("{}-points-{}", id, model.name)},
                       {"low", -3.5},
                       {"high", 3.5},
                       {"y_low", std::max(limits.low, -12.0)},
                       {"y_high", std::min(limits.high, 12.0)},
                       {"y_title", of_cells  ? "cell residual / spread"
                                   : bearing ? "bearing residual / spread"
                                             : "range residual / spread"},
                       {"colour", model.colour}},
                      model.title,
                      of_cells
                          ? "One dot per stop and landmark: steeper than the line where whole cells are off. "
                            "What the model knows of the dependence is not taken away."
                          : "On the line where residuals are normal; tails leave it.",
                      "plot"});
  return charts;
}

std::vector<Chart> repeats(Page& page, const std::string& id, bool bearing,
                           const std::vector<Model>& models) {
  std::vector<Chart> charts;
  for (const Model& model : models) {
    const std::vector<ReadingResidual>& readings = model.view->residuals.readings;
    Json rows = Json::array(), line = Json::array();
    double xx = 0.0, xy = 0.0;
    std::vector<std::size_t> firsts;
    for (std::size_t i = 0; i + 1 < readings.size(); ++i) {
      const ReadingResidual &a = readings[i], &b = readings[i + 1];
      if (a.recording != b.recording || a.stop != b.stop || a.landmark != b.landmark || a.stop < 0) continue;
      firsts.push_back(i);
      xx += standardised(a, bearing) * standardised(a, bearing);
      xy += standardised(a, bearing) * standardised(b, bearing);
    }
    if (firsts.empty()) return {};
    for (std::size_t i : shown(firsts.size())) {
      Json row;
      name_reading(*model.view, readings[firsts[i]], row);
      row["value"] = number(standardised(readings[firsts[i]], bearing));
      row["next"] = number(standardised(readings[firsts[i] + 1], bearing));
      rows.push_back(std::move(row));
    }
    const double slope = xy / xx, std_dev = std::sqrt((1.0 - std::min(1.0, slope * slope)) /
                                                      static_cast<double>(firsts.size()));
    for (double at : {-4.0, 4.0}) line.push_back({{"value", at}, {"next", number(slope * at)}});
    const std::string points = fmt::format("{}-points-{}", id, model.name),
                      fit = fmt::format("{}-line-{}", id, model.name);
    page.dataset(points, rows);
    page.dataset(fit, line);
    const char* what = bearing ? "bearing residual / spread" : "range residual / spread";
    charts.push_back(
        {fmt::format("{}-{}", id, model.name),
         "repeats",
         {{"points", points},
          {"line", fit},
          {"colour", model.colour},
          {"x_title", what},
          {"y_title", "the next repeat's"}},
         model.title,
         fmt::format(
             "Independent readings make a round cloud; this one leans by {:.2f} +- {:.2f}. What the model knows "
             "of the dependence is not taken away.",
             slope, std_dev),
         "plot"});
  }
  return charts;
}

/// One value per (stop, landmark) cell against its distance; cells without a reading are cells too.
std::vector<Chart> cells(Page& page, const std::string& id, const FitView& view, const std::string& title,
                         const std::string& caption, const std::string& y_title,
                         const std::function<double(const std::vector<const ReadingResidual*>&)>& value,
                         bool with_empty) {
  std::map<std::tuple<int, int, int>, std::vector<const ReadingResidual*>> all;
  for (const ReadingResidual& x : view.residuals.readings) {
    if (x.stop < 0) return {};
    all[{x.recording, x.stop, x.landmark}].push_back(&x);
  }
  Json rows = Json::array();
  for (const auto& [key, readings] : all) {
    Json row;
    name_reading(view, *readings.front(), row);
    row["distance"] = number(readings.front()->distance_m);
    row["value"] = number(value(readings));
    rows.push_back(std::move(row));
  }
  if (with_empty) {
    std::size_t first = 0;
    for (std::size_t r = 0; r < view.recordings.size(); ++r) {
      const Recording& recording = view.recordings[r];
      for (std::size_t k = 0; k < recording.stops.size(); ++k)
        for (std::size_t l = 0; l < recording.landmarks.size(); ++l) {
          if (all.count({static_cast<int>(r), static_cast<int>(k), static_cast<int>(l)})) continue;
          const auto at = std::find_if(view.calibration.landmarks.begin(), view.calibration.landmarks.end(),
                                       [&](const LandmarkEstimate& e) {
                                         return e.recording == static_cast<int>(r) &&
                                                e.label == recording.landmarks[l].label;
                                       });
          if (at == view.calibration.landmarks.end() || view.calibration.stops.empty()) continue;
          const Pose2& pose = view.calibration.stops[first + k].pose;
          const double d =
              (at->position_m - Eigen::Vector2d(pose.x_m, pose.y_m)).norm() - recording.landmarks[l].radius_m;
          rows.push_back({{"recording", r},
                          {"stop", recording.stops[k].label},
                          {"landmark", recording.landmarks[l].label},
                          {"row", "none"},
                          {"distance", number(d)},
                          {"value", 0}});
        }
      first += recording.stops.size();
    }
  }
  page.dataset(id + "-points", rows);
  return {
      {id + "-before", "cells", {{"points", id + "-points"}, {"y_title", y_title}}, title, caption, "plot"}};
}

std::vector<Chart> moves(Page& page, const std::string& id, const std::vector<Model>& models) {
  Json rows = Json::array(), names = Json::array(), colours = Json::array();
  for (const Model& model : models) {
    const FitView& view = *model.view;
    if (view.calibration.stops.empty()) return {};
    const char* name = model.name[0] == 'b' ? "seed model" : "completed model";
    names.push_back(name);
    colours.push_back(model.colour);
    std::size_t k = 0;
    for (const Recording& recording : view.recordings)
      for (const Stop& stop : recording.stops) {
        const Pose2& pose = view.calibration.stops[k].pose;
        for (int axis : {0, 1}) {
          const double moved =
              1e3 * (axis == 0 ? pose.x_m - stop.commanded.x_m : pose.y_m - stop.commanded.y_m);
          const bool known = k < view.covariance.stops.size() && view.covariance.stops[k];
          const double half = known ? 1e3 * z95 * std::sqrt((*view.covariance.stops[k])(axis, axis)) : 0.0;
          rows.push_back({{"model", name},
                          {"axis", axis == 0 ? "x" : "y"},
                          {"number", k + 1},
                          {"stop", stop.label},
                          {"moved", number(moved)},
                          {"low", number(moved - half)},
                          {"high", number(moved + half)}});
        }
        ++k;
      }
  }
  page.dataset(id + "-points", rows);
  std::vector<Chart> charts;
  for (const char* axis : {"x", "y"})
    charts.push_back({fmt::format("{}-{}", id, axis),
                      "moves",
                      {{"points", id + "-points"}, {"axis", axis}, {"models", names}, {"colours", colours}},
                      fmt::format("Stops against their commanded places, in {}", axis),
                      "Estimated less commanded, with its 95 % band.",
                      "plot"});
  return charts;
}

}  // namespace

std::vector<Chart> charts_beyond_means(Page& page, const std::string& id, const Finding& finding,
                                       const FitView& before, const FitView* after) {
  const bool bearing = finding.channel.rfind("bearing", 0) == 0 || finding.covariate == "sensor_bearing";
  const std::vector<Model> models = models_of(before, after);
  if (bearing && before.calibration.kind == RecordingKind::pairs) return {};
  if (ends_with(finding.channel, "_tail")) return quantiles(page, id, bearing, false, models);
  if (ends_with(finding.channel, "_dependence"))
    return finding.covariate == "repeat" ? repeats(page, id, bearing, models)
                                         : quantiles(page, id, bearing, true, models);
  if (finding.channel == "stop") return moves(page, id, models);
  if (finding.channel == "grid")
    return cells(
        page, id, before, "Values that are unlike all others of their cell",
        "One dot per stop and landmark. Readings that are free take a new value each time, at 1; on a grid "
        "values return.",
        "distinct values / readings",
        [bearing](const std::vector<const ReadingResidual*>& readings) {
          std::set<double> values;
          for (const ReadingResidual* x : readings) values.insert(bearing ? x->bearing_rad : x->range_m);
          return static_cast<double>(values.size()) / static_cast<double>(readings.size());
        },
        false);
  if (finding.channel == "detection")
    return cells(
        page, id, before, "Readings that came back",
        "One dot per stop and landmark, those without a reading at 0.", "readings",
        [](const std::vector<const ReadingResidual*>& readings) {
          return static_cast<double>(readings.size());
        },
        true);
  return {};
}

}  // namespace rangecal::report
