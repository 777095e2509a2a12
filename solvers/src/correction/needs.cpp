// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <map>

#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/correction/effect_correction.hpp"

namespace rangecal {

// Readings near, in the middle and far, of every landmark, are moved along one column after the other: what changes none of
// them is not needed. Cost: effects x landmarks x columns.
std::vector<EffectCorrector::Need> EffectCorrector::needs() const {
  EffectContext context = context_;
  context.covariates.insert(context.covariates.end(), {"temperature_c", "intensity"});
  if (!(context.duration_s > 0.0)) context.duration_s = 3600.0;
  for (const Active& active : active_)
    if (const std::string column = column_in_id(active.effect->info().id); !column.empty())
      context.covariates.push_back(column);
  std::vector<double> columns(context.covariates.size(), 20.0);
  std::map<std::string, std::vector<std::size_t>> places;  // of the columns of one name
  for (std::size_t c = 0; c < columns.size(); ++c) places[context.covariates[c]].push_back(c);

  std::vector<ReadingView<double>> views;
  ReadingSetting setting;
  setting.bearing_rad = 0.3, setting.heading_rad = 0.2, setting.time_s = 1.0, setting.radius_m = 0.05;
  for (const double share : {0.1, 0.5, 0.9})
    for (setting.landmark = 0; setting.landmark < std::max(1, context.landmark_count); ++setting.landmark) {
      const double width = calibration_.range_max_m - calibration_.range_min_m;
      views.push_back(view(calibration_.range_min_m + share * width, setting));
      views.back().context = &context;
      views.back().covariate = columns.data();
      views.back().stop = std::max(0, context.stop_count - 1);
    }

  std::vector<Need> needs;
  for (const Active& active : active_) {
    const auto reading = [&](const ReadingView<double>& at) {
      return active.effect->reading(at, active.parameters.data());
    };
    std::vector<ReadingChange<double>> before;
    before.reserve(views.size());
    for (const ReadingView<double>& at : views) before.push_back(reading(at));
    const auto matters = [&](const auto& move) {
      for (std::size_t i = 0; i < views.size(); ++i) {
        ReadingView<double> moved = views[i];
        move(moved);
        const ReadingChange<double> after = reading(moved);
        if (after.range != before[i].range || after.range_log_variance != before[i].range_log_variance)
          return true;
      }
      return false;
    };
    const auto ask = [&](const std::string& column, const auto&... moves) {
      if ((matters(moves) || ...)) needs.push_back({column, active.effect->info().id});
    };
    ask(
        "bearing_rad", [](auto& v) { v.bearing = 1.1; }, [](auto& v) { v.bearing = -2.0; },
        [](auto& v) { v.bearing = 2.9; });
    ask("heading_rad", [](auto& v) { v.heading = 1.2; });
    const bool by_time = matters([](auto& v) { v.time_s = 100.0; });
    context.duration_s *= 2.0;
    const bool by_duration = matters([](auto&) {});
    context.duration_s *= 0.5;
    if (by_duration && !(context_.duration_s > 0.0))
      throw InputError(
          "the calibration's effect " + active.effect->info().id +
          " counts time in durations of its recording, and effects_range does not say how long that was: "
          "it lacks time_s");
    if (by_time || by_duration) needs.push_back({"time_s", active.effect->info().id});
    ask("radius_m", [](auto& v) {
      v.radius = 0.02;
      v.axis_distance = v.d + 0.02;
    });
    ask("landmark", [](auto& v) { v.landmark = -1; });
    ask("stop", [](auto& v) { v.stop = 0; });
    ask("repeat", [](auto& v) { v.repeat = 1; });
    for (std::size_t c = 0; c < columns.size(); ++c) {
      const std::vector<std::size_t>& same = places[context.covariates[c]];
      if (same.front() != c) continue;
      for (const std::size_t place : same) columns[place] = 35.0;
      ask(context.covariates[c], [](auto&) {});
      for (const std::size_t place : same) columns[place] = 20.0;
    }
  }
  return needs;
}

}  // namespace rangecal
