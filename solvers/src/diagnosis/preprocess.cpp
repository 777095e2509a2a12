// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/preprocess.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <utility>

#include "diagnosis/labels.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/extract/extract.hpp"

namespace rangecal::diagnosis {
namespace {

/// Correlation of a covariate with the reading about the means of readings of the same distance; 0 where too few
/// repeat. `group`: a number of the distance, by row.
double correlation_within(const std::vector<int>& group, const std::vector<double>& reading,
                          const std::vector<double>& covariate) {
  constexpr double fewest = 20.0;  // degrees of freedom
  struct Sums {                    ///< taken from the group's first row
    double first_x, first_y, count = 0.0, x = 0.0, y = 0.0, xx = 0.0, yy = 0.0, xy = 0.0;
  };
  std::map<int, Sums> groups;
  for (std::size_t i = 0; i < reading.size(); ++i) {
    if (!std::isfinite(covariate[i])) continue;
    Sums& s = groups.try_emplace(group[i], Sums{reading[i], covariate[i]}).first->second;
    const double x = reading[i] - s.first_x, y = covariate[i] - s.first_y;
    s.count += 1.0;
    s.x += x, s.y += y;
    s.xx += x * x, s.yy += y * y, s.xy += x * y;
  }
  double dof = 0.0, correlation = 0.0;
  for (const auto& [number, s] : groups) {
    // Each group in units of its own spreads: noise grows with distance, and so may the covariate's.
    const double xx = s.xx - s.x * s.x / s.count, yy = s.yy - s.y * s.y / s.count;
    if (!(xx > 0.0 && yy > 0.0)) continue;
    dof += s.count - 1.0;
    correlation += (s.count - 1.0) * (s.xy - s.x * s.y / s.count) / std::sqrt(xx * yy);
  }
  return dof < fewest ? 0.0 : correlation / dof;
}

/// Names of the covariates that follow the reading's own error.
std::vector<std::string> derived_covariates(const Recording& recording) {
  constexpr double follows = 0.7;  // rounding leaves that much; a physical cause of the error a tenth
  const bool pairs = recording.kind == RecordingKind::pairs;
  const Readings& r = recording.readings;
  const Pairs& p = recording.pairs;
  const Covariates& covariates = pairs ? p.covariates : r.covariates;
  if (covariates.empty()) return {};
  std::vector<int> group;
  if (pairs) {
    std::map<double, int> distances;
    for (const double d : p.true_m)
      group.push_back(distances.try_emplace(d, static_cast<int>(distances.size())).first->second);
  } else {
    const auto landmarks = static_cast<int>(recording.landmarks.size());
    for (std::size_t i = 0; i < r.size(); ++i) group.push_back(r.stop[i] * landmarks + r.landmark[i]);
  }
  std::vector<std::string> names;
  for (const auto& [name, values] : covariates)
    if (std::abs(correlation_within(group, pairs ? p.reading_m : r.range_m, values)) > follows)
      names.push_back(name);
  return names;
}

/// Covariates from which no physics can be read, and why.
std::vector<std::pair<std::string, const char*>> unused_covariates(const Recording& recording) {
  std::vector<std::pair<std::string, const char*>> unused;
  for (const char* name : {range_sd_column, bearing_sd_column})
    unused.emplace_back(name, "it says how uncertain a reading is, and nothing of what made it");
  for (const std::string& name : derived_covariates(recording))
    unused.emplace_back(
        name,
        "it follows the reading's own error from repeat to repeat, so that it was computed from the reading");
  std::erase_if(unused, [&](const auto& column) {
    return recording.readings.covariates.count(column.first) +
               recording.pairs.covariates.count(column.first) ==
           0;
  });
  return unused;
}

/// sigma_xy by `marginal`; half its upper limit where the estimate is 0. None where nothing can be said.
std::optional<double> estimated_sigma_xy(std::vector<Recording> recordings) {
  correct_labels(recordings);
  CalibrateOptions options;
  options.methods = {Method::marginal};
  options.noise_shape = NoiseShape::gaussian;  // the seed model's; tails are an effect
  options.order = 2;
  const Calibration c = calibrate_report(recordings, options).calibrations.at(0);
  if (!is_usable(c.outcome) || !c.sigma_s_m) return std::nullopt;
  if (c.sigma_s_m->value > 0.0) return c.sigma_s_m->value;
  if (c.sigma_s_upper95_m) return 0.5 * *c.sigma_s_upper95_m;
  return std::nullopt;
}

}  // namespace

std::optional<Preprocessed> preprocess(std::span<const Recording> recordings) {
  Preprocessed result;
  const std::vector<std::string> unseen = unseen_landmarks(recordings);
  std::vector<std::vector<std::pair<std::string, const char*>>> unused;
  for (const Recording& recording : recordings) unused.push_back(unused_covariates(recording));
  const bool estimate = std::any_of(recordings.begin(), recordings.end(),
                                    [](const Recording& r) { return r.estimate_sigma_xy; });
  std::vector<std::vector<MisreadLabel>> misread;
  for (const Recording& recording : recordings) misread.push_back(misread_labels(recording));
  const bool misreads = std::any_of(misread.begin(), misread.end(), [](const auto& m) { return !m.empty(); });
  const bool drops =
      std::any_of(unused.begin(), unused.end(), [](const auto& columns) { return !columns.empty(); });
  if (unseen.empty() && !drops && !misreads && !estimate) return std::nullopt;
  for (std::size_t i = 0; i < misread.size(); ++i) {
    result.recordings.push_back(without_misread(recordings[i], misread[i]));
    if (misread[i].empty()) continue;
    std::size_t readings = 0;
    for (const MisreadLabel& m : misread[i]) readings += m.readings.size();
    result.notes.push_back(fmt::format(
        "left out, {} reading(s) in a direction in which the landmark is not (a label misread?): {}",
        readings, in_words(misread[i], recordings[i])));
  }
  result.recordings = with_seen_landmarks(result.recordings);
  if (!unseen.empty())
    result.notes.push_back(fmt::format("left out, never seen: landmark {}", fmt::join(unseen, ", ")));
  for (std::size_t i = 0; i < unused.size(); ++i)
    for (const auto& [name, because] : unused[i]) {
      Recording& recording = result.recordings[i];
      if (recording.readings.covariates.erase(name) + recording.pairs.covariates.erase(name) > 0)
        result.notes.push_back(fmt::format("column {} was not used: {}", name, because));
    }
  if (estimate) {
    const std::optional<double> sigma = estimated_sigma_xy(result.recordings);
    for (Recording& recording : result.recordings) {
      if (!recording.estimate_sigma_xy) continue;
      recording.estimate_sigma_xy = false;
      if (sigma) recording.sigma_xy_m = *sigma;
    }
    if (sigma)
      result.notes.push_back(fmt::format(
          "sigma_xy_m was estimated, {:.1f} mm: that stops are off by more or less cannot be found "
          "beside it",
          1e3 * *sigma));
  }
  return result;
}

}  // namespace rangecal::diagnosis
