// SPDX-License-Identifier: BSD-3-Clause
#include "residuals.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <numbers>
#include <set>

#include "diagnosis_words.hpp"
#include "findings_beyond_means.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal::report {
namespace {

using app::ends_with;

constexpr double degree = std::numbers::pi / 180.0;

/// How a covariate is shown.
struct Axis {
  std::string title;
  double factor = 1.0;
  bool groups = false;  ///< labels instead of numbers
  const char* format = ".3f";
};
Axis axis_of(const std::string& covariate) {
  if (covariate == "range" || covariate == "constant") return {"true distance d [m]"};
  if (covariate == "disparity") return {"1 / d [1/m]"};
  if (covariate == "sensor_bearing") return {"direction in the sensor frame [°]", 1.0 / degree, false, ".1f"};
  if (covariate == "heading") return {"heading of the stop [°]", 1.0 / degree, false, ".1f"};
  if (covariate == "time") return {"time [s]", 1.0, false, ".1f"};
  if (covariate == "stop") return {"stop", 1.0, true};
  if (covariate == "repeat") return {"repeat at one stop", 1.0, false, ".0f"};
  if (covariate == "landmark") return {"landmark", 1.0, true};
  if (covariate == "radius") return {"radius of the landmark [m]"};
  return {covariate, 1.0, false, ".4~g"};
}

/// What of a reading is shown on the other axis.
struct Channel {
  bool bearing = false, spread = false;
  std::string title() const {
    const std::string what = bearing ? "bearing" : "range";
    if (spread) return "|" + what + " residual| / spread";
    return what + (bearing ? " residual [°]" : " residual [mm]");
  }
  double of(const ReadingResidual& x) const {
    const double residual = bearing ? x.bearing_residual_rad : x.range_residual_m;
    if (spread) return std::abs(residual) / (bearing ? x.bearing_std_rad : x.range_std_m);
    return bearing ? residual / degree : 1e3 * residual;
  }
  /// A bin's mean, or from its log variance ratio the ratio of spreads.
  double of_bin(double value) const {
    return spread ? std::exp(0.5 * value) : bearing ? value / degree : 1e3 * value;
  }
};
Channel channel_of(const std::string& channel) {
  return {channel.rfind("bearing", 0) == 0, ends_with(channel, "_noise")};
}

/// The label of a landmark or stop by its number over all recordings.
std::string label_of(const FitView& view, const std::string& covariate, double number_of_group) {
  std::size_t index = static_cast<std::size_t>(std::lround(number_of_group));
  for (const Recording& recording : view.recordings) {
    const std::size_t count = covariate == "stop" ? recording.stops.size() : recording.landmarks.size();
    if (index < count)
      return covariate == "stop" ? recording.stops[index].label : recording.landmarks[index].label;
    index -= count;
  }
  return "–";
}

Json place_of(const FitView& view, const Axis& axis, const std::string& covariate, double value) {
  return axis.groups ? Json(label_of(view, covariate, value)) : number(axis.factor * value);
}

/// The labels of a grouped covariate in the order of the recordings.
Json order_of(const FitView& view, const std::string& covariate) {
  Json labels = Json::array();
  for (const Recording& recording : view.recordings) {
    if (covariate == "stop")
      for (const Stop& stop : recording.stops) labels.push_back(stop.label);
    else
      for (const Landmark& landmark : recording.landmarks) labels.push_back(landmark.label);
  }
  return labels;
}

/// One pair of charts: names, data, and what both share.
struct Pair {
  std::string id, covariate;
  Channel channel;
  Axis axis;
  Limits limits;
  Json sort;  ///< labels in order, or null
};

Chart chart_of(const Pair& pair, bool after, std::size_t readings, const std::string& title,
               const std::string& caption) {
  const std::string colour = after ? "var(--after)" : "var(--before)";
  return {fmt::format("{}-{}", pair.id, after ? "after" : "before"),
          "residual",
          {{"points", pair.id + "-points"},
           {"bins", fmt::format("{}-bins-{}", pair.id, after ? "after" : "before")},
           {"field", after ? "after" : "before"},
           {"type", pair.axis.groups ? "ordinal" : "quantitative"},
           {"band_mark", pair.axis.groups ? "bar" : "area"},
           {"line_width", pair.axis.groups ? 0 : 2},
           {"x_title", pair.axis.title},
           {"x_sort", pair.sort},
           {"x_zero", pair.axis.groups ? Json(nullptr) : Json(false)},
           {"x_padding", pair.axis.groups ? Json(nullptr) : Json(6)},
           {"x_format", pair.axis.groups ? Json(nullptr) : Json(pair.axis.format)},
           {"y_title", pair.channel.title()},
           {"bin_title", pair.channel.spread ? "spread / modelled" : "mean of the bin"},
           {"low", pair.channel.spread ? 0.0 : pair.limits.low},
           {"high", pair.limits.high},
           {"reference", pair.channel.spread ? 1 : 0},
           {"colour", colour}},
          title,
          caption.empty() ? shown_in_words(readings) : caption + " " + shown_in_words(readings),
          "plot"};
}

Json bin_row(const Json& at, double mean, double low, double high, int readings) {
  return {{"at", at},
          {"mean", number(mean)},
          {"low", number(low)},
          {"high", number(high)},
          {"readings", readings}};
}

/// Points of one or two models; `along` holds the covariate of every reading.
Json point_rows(const FitView& before, const FitView* after, const Pair& pair,
                const std::vector<double>& along) {
  Json rows = Json::array();
  for (std::size_t i : shown(along.size())) {
    const ReadingResidual& x = before.residuals.readings[i];
    Json row;
    name_reading(before, x, row);
    row["along"] = place_of(before, pair.axis, pair.covariate, along[i]);
    row["before"] = number(pair.channel.of(x));
    if (after) row["after"] = number(pair.channel.of(after->residuals.readings[i]));
    rows.push_back(std::move(row));
  }
  return rows;
}

Limits limits_of_points(const FitView& before, const FitView* after, const Channel& channel) {
  std::vector<double> values;
  for (const ReadingResidual& x : before.residuals.readings) values.push_back(channel.of(x));
  if (after)
    for (const ReadingResidual& x : after->residuals.readings) values.push_back(channel.of(x));
  return limits_of(values);
}

/// The limits drawn in where they let the means be seen: a third of the height for the bins that reach
/// farthest.
Limits zoomed(const Limits& points, double reach, const Channel& channel) {
  if (channel.spread) return {0.0, std::min(points.high, 3.0 * reach)};
  const double half = std::min(std::max(std::abs(points.low), std::abs(points.high)), 3.0 * reach);
  return {-half, half};
}

/// "12 of 1440 readings lie beyond the scale." Empty where none does.
std::string beyond(const std::vector<ReadingResidual>& readings, const Pair& pair) {
  const auto out = std::count_if(readings.begin(), readings.end(), [&](const ReadingResidual& x) {
    const double value = pair.channel.of(x);
    return value < pair.limits.low || value > pair.limits.high;
  });
  return out == 0 ? ""
                  : fmt::format("{} of {} readings lie beyond the scale, which shows the means.", out,
                                readings.size());
}

}  // namespace

std::vector<std::string> covariates_of(const Diagnosis& diagnosis) {
  std::set<std::string> names;
  for (const Finding& f : diagnosis.location) names.insert(f.covariate);
  return {names.begin(), names.end()};
}

namespace {

/// Bearings along the stops, labels as recorded and as put back.
std::vector<Chart> charts_of_labels(Page& page, const std::string& id, const FitView& recorded,
                                    const FitView& put_back) {
  Pair pair{id, "stop", {true, false}, axis_of("stop"), {}, order_of(recorded, "stop")};
  double reach = 0.0;
  for (const ReadingResidual& x : recorded.residuals.readings)
    reach = std::max(reach, std::abs(pair.channel.of(x)));
  pair.limits = {-1.1 * reach, 1.1 * reach};
  std::vector<Chart> charts;
  for (const bool after : {false, true}) {
    const FitView& view = after ? put_back : recorded;
    std::vector<double> along;
    std::size_t first = 0;
    for (std::size_t i = 0; i < view.residuals.readings.size(); ++i) {
      const ReadingResidual& x = view.residuals.readings[i];
      if (i > 0 && x.recording != view.residuals.readings[i - 1].recording)
        first += view.recordings[static_cast<std::size_t>(x.recording) - 1].stops.size();
      along.push_back(static_cast<double>(first) + x.stop);
    }
    Pair own = pair;
    own.id = fmt::format("{}-{}", id, after ? "put-back" : "recorded");
    page.dataset(own.id + "-points", point_rows(view, nullptr, own, along));
    page.dataset(own.id + "-bins-before", Json::array());
    charts.push_back(chart_of(own, false, along.size(),
                              after ? "After: labels put back" : "Before: labels as recorded", ""));
  }
  return charts;
}

std::vector<Chart> charts_of_means(Page& page, const std::string& id, const Finding& f, const FitView& before,
                                   const FitView* after) {
  const auto along = before.residuals.along.find(f.covariate);
  if (along == before.residuals.along.end()) return {};
  Pair pair{id, f.covariate, channel_of(f.channel), axis_of(f.covariate), {}, nullptr};
  if (pair.axis.groups) pair.sort = order_of(before, f.covariate);
  double reach = 0.0;
  for (const BinnedResidual& b : f.residuals)
    reach = std::max({reach, std::abs(pair.channel.of_bin(b.before + z95 * b.std_dev)),
                      std::abs(pair.channel.of_bin(b.before - z95 * b.std_dev))});
  pair.limits = zoomed(limits_of_points(before, after, pair.channel), reach, pair.channel);
  page.dataset(pair.id + "-points", point_rows(before, after, pair, along->second));
  for (const bool completed : {false, true}) {
    Json bins = Json::array();
    for (const BinnedResidual& b : f.residuals) {
      const double mean = completed ? b.after : b.before;
      bins.push_back(bin_row(place_of(before, pair.axis, f.covariate, b.at), pair.channel.of_bin(mean),
                             pair.channel.of_bin(mean - z95 * b.std_dev),
                             pair.channel.of_bin(mean + z95 * b.std_dev), b.readings));
    }
    page.dataset(fmt::format("{}-bins-{}", pair.id, completed ? "after" : "before"), bins);
  }
  std::vector<Chart> charts{chart_of(pair, false, along->second.size(), "Before: the seed model",
                                     beyond(before.residuals.readings, pair))};
  if (after)
    charts.push_back(chart_of(pair, true, along->second.size(), "After: the completed model",
                              beyond(after->residuals.readings, pair)));
  return charts;
}

}  // namespace

int add_findings(Page& page, const Diagnosis& diagnosis, const FitView& recorded, const FitView& before,
                 const FitView* after, int most) {
  int drawn = 0;
  for (const Finding& f : diagnosis.location) {
    if (drawn == most) break;
    const std::string id = fmt::format("finding-{}", drawn + 1);
    const std::vector<Chart> charts = f.channel == "label"  ? charts_of_labels(page, id, recorded, before)
                                      : f.residuals.empty() ? charts_beyond_means(page, id, f, before, after)
                                                            : charts_of_means(page, id, f, before, after);
    if (charts.empty()) continue;
    ++drawn;
    page.heading(app::finding_in_words(f));
    page.charts(charts);
  }
  return drawn;
}

void add_plain_residuals(Page& page, const FitView& view) {
  std::vector<Chart> charts;
  for (const bool bearing : {false, true}) {
    const std::string covariate = bearing ? "sensor_bearing" : "range";
    const auto along = view.residuals.along.find(covariate);
    if (along == view.residuals.along.end() || (bearing && view.calibration.kind == RecordingKind::pairs))
      continue;
    Pair pair{"residual-" + covariate, covariate, {bearing, false}, axis_of(covariate), {}, nullptr};
    page.dataset(pair.id + "-points", point_rows(view, nullptr, pair, along->second));
    struct Bin {
      double at = 0.0, sum = 0.0, variance = 0.0;
      int readings = 0;
    };
    std::map<int, Bin> bins;
    const std::vector<int> bin = bins_of_equal_shares(along->second);
    for (std::size_t i = 0; i < bin.size(); ++i) {
      const ReadingResidual& x = view.residuals.readings[i];
      Bin& b = bins[bin[i]];
      b.at += along->second[i];
      b.sum += pair.channel.of(x);
      b.variance += std::pow(bearing ? x.bearing_std_rad / degree : 1e3 * x.range_std_m, 2);
      ++b.readings;
    }
    Json rows = Json::array();
    double reach = 0.0;
    for (const auto& [index, b] : bins) {
      if (index < 0) continue;
      const double mean = b.sum / b.readings, half = z95 * std::sqrt(b.variance) / b.readings;
      reach = std::max(reach, std::abs(mean) + half);
      rows.push_back(
          bin_row(number(pair.axis.factor * b.at / b.readings), mean, mean - half, mean + half, b.readings));
    }
    pair.limits = zoomed(limits_of_points(view, nullptr, pair.channel), reach, pair.channel);
    page.dataset(pair.id + "-bins-before", rows);
    charts.push_back(chart_of(pair, false, along->second.size(), bearing ? "Bearings" : "Ranges",
                              beyond(view.residuals.readings, pair)));
    charts.back().values["colour"] = "var(--after)";
  }
  page.charts(charts);
}

}  // namespace rangecal::report
