// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/preprocess.hpp"

#include <fmt/core.h>
#include <fmt/ranges.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>
#include <set>
#include <string>
#include <utility>

#include "diagnosis/labels.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/core/without_readings.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/extract/extract.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// Moments of readings x, of one distance say, and a column y at them.
class ColumnMoments {
 public:
  void add(double x, double y) {
    if (count_ == 0.0) first_x_ = x, first_y_ = y;
    x -= first_x_, y -= first_y_;
    count_ += 1.0;
    x_ += x, y_ += y;
    xx_ += x * x, yy_ += y * y, xy_ += x * y;
  }
  double count() const { return count_; }
  double mean_x() const { return first_x_ + x_ / count_; }
  double mean_y() const { return first_y_ + y_ / count_; }
  double scatter_x() const { return xx_ - x_ * x_ / count_; }
  double scatter_y() const { return yy_ - y_ * y_ / count_; }
  double scatter_xy() const { return xy_ - x_ * y_ / count_; }
  /// True if both scatter.
  bool vary() const { return scatter_x() > 0.0 && scatter_y() > 0.0; }

 private:
  double first_x_ = 0.0, first_y_ = 0.0;  ///< the sums are about the first
  double count_ = 0.0, x_ = 0.0, y_ = 0.0, xx_ = 0.0, yy_ = 0.0, xy_ = 0.0;
};

/// Those of every distance at which both are known, by their mean reading. `group`: a number of the distance, by row.
std::vector<ColumnMoments> moments_by_distance(const std::vector<int>& group,
                                               const std::vector<double>& reading,
                                               const std::vector<double>& column) {
  std::map<int, ColumnMoments> by_group;
  for (std::size_t i = 0; i < reading.size(); ++i)
    if (std::isfinite(reading[i]) && std::isfinite(column[i])) by_group[group[i]].add(reading[i], column[i]);
  std::vector<ColumnMoments> distances;
  for (const auto& [number, one] : by_group) distances.push_back(one);
  std::sort(distances.begin(), distances.end(),
            [](const ColumnMoments& a, const ColumnMoments& b) { return a.mean_x() < b.mean_x(); });
  return distances;
}

/// Correlation of a column with the reading about the means of every distance; 0 where too few repeat.
double correlation_within(const std::vector<ColumnMoments>& distances) {
  constexpr double fewest = 20.0;  // degrees of freedom
  double dof = 0.0, correlation = 0.0;
  for (const ColumnMoments& r : distances) {
    // Each group in units of its own spreads: noise grows with distance, and so may the column's.
    if (!r.vary()) continue;
    dof += r.count() - 1.0;
    correlation += (r.count() - 1.0) * r.scatter_xy() / std::sqrt(r.scatter_x() * r.scatter_y());
  }
  return dof < fewest ? 0.0 : correlation / dof;
}

/// Slope of a column's means by the mean readings of a distance and its neighbours.
double slope_between(const std::vector<ColumnMoments>& distances, std::size_t at) {
  const std::size_t reach = std::max<std::size_t>(1, distances.size() / 10);
  ColumnMoments means;
  for (std::size_t i = at < reach ? 0 : at - reach; i < std::min(distances.size(), at + reach + 1); ++i)
    means.add(distances[i].mean_x(), distances[i].mean_y());
  return means.scatter_xy() / means.scatter_x();
}

/// True if a column is a function of the reading. It moves with the reading's error from repeat to repeat, as a cause of that error does;
/// but it moves as much when the reading changes with the distance, and a cause knows nothing of that.
bool is_function_of_reading(const std::vector<ColumnMoments>& distances) {
  constexpr double follows = 0.7;  // rounding leaves that much
  constexpr double least = 0.5,
                   largest = 2.0;  // of the slope from repeat to repeat over that from distance to distance
  if (distances.size() < 2 || !(std::abs(correlation_within(distances)) > follows)) return false;
  std::vector<double> ratios;
  for (std::size_t i = 0; i < distances.size(); ++i) {
    if (!distances[i].vary()) continue;
    ratios.push_back(distances[i].scatter_xy() / distances[i].scatter_x() / slope_between(distances, i));
  }
  std::erase_if(ratios, [](double ratio) { return std::isnan(ratio); });
  if (ratios.empty()) return false;
  const double ratio = upper_median(std::move(ratios));
  return ratio > least && ratio < largest;
}

/// True if a column is the difference of reading and distance, which every cause of it would have to explain.
bool is_error_of_reading(const Pairs& p, const std::vector<double>& column) {
  constexpr double same = 0.9995;  // correlation; a cause beside noise of a thirtieth of it
  ColumnMoments all;
  for (std::size_t i = 0; i < p.size(); ++i)
    if (std::isfinite(p.reading_m[i]) && std::isfinite(column[i]))
      all.add(p.reading_m[i] - p.true_m[i], column[i]);
  return all.count() > 2.0 && all.vary() &&
         std::abs(all.scatter_xy()) > same * std::sqrt(all.scatter_x() * all.scatter_y());
}

using Unused = std::vector<std::pair<std::string, std::string>>;  ///< columns, and why

/// Columns that were computed from the reading.
Unused derived_covariates(const Recording& recording) {
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
  Unused derived;
  for (const auto& [name, values] : covariates) {
    if (pairs && is_error_of_reading(p, values))
      derived.emplace_back(name, "it is the reading's own error");
    else if (is_function_of_reading(moments_by_distance(group, pairs ? p.reading_m : r.range_m, values)))
      derived.emplace_back(
          name,
          "it follows the reading, from repeat to repeat as from distance to distance, so that it was "
          "computed from it");
  }
  return derived;
}

/// Of known distances, the readings that lack a column which others have: what it does to them would be taken for something else.
std::vector<char> incomplete_readings(const Recording& recording,
                                      const std::set<std::string>& given_up = {}) {
  std::vector<char> out(recording.pairs.size());
  for (const auto& [name, values] : recording.pairs.covariates)
    for (std::size_t i = 0; i < out.size() && !given_up.count(name); ++i)
      if (!std::isfinite(values[i])) out[i] = 1;
  return out;
}

/// Columns of known distances that are given up, those that most readings lack first, until half of the readings lack none.
Unused sparse_covariates(const Recording& recording) {
  const std::size_t readings = recording.pairs.size();
  std::map<std::string, std::size_t> missing;
  for (const auto& [name, values] : recording.pairs.covariates)
    missing[name] = static_cast<std::size_t>(
        std::count_if(values.begin(), values.end(), [](double value) { return !std::isfinite(value); }));
  Unused sparse;
  std::set<std::string> given_up;
  for (;;) {
    const std::vector<char> out = incomplete_readings(recording, given_up);
    if (2 * static_cast<std::size_t>(std::count(out.begin(), out.end(), 1)) <= readings) return sparse;
    const auto most = std::max_element(missing.begin(), missing.end(),
                                       [](const auto& a, const auto& b) { return a.second < b.second; });
    sparse.emplace_back(most->first, fmt::format("{} of {} readings lack it", most->second, readings));
    given_up.insert(most->first);
    missing.erase(most);
  }
}

/// Columns from which no physics can be read.
Unused unused_covariates(const Recording& recording) {
  Unused unused;
  for (const char* name : {range_sd_column, bearing_sd_column})
    unused.emplace_back(name, "it says how uncertain a reading is, and nothing of what made it");
  for (const Unused& more : {derived_covariates(recording), sparse_covariates(recording)})
    unused.insert(unused.end(), more.begin(), more.end());
  std::erase_if(unused, [&](const auto& column) {
    return recording.readings.covariates.count(column.first) +
               recording.pairs.covariates.count(column.first) ==
           0;
  });
  return unused;
}

/// Of known distances, the rows that say what another row says, in every column, where hardly any two others agree even in all but the
/// reading: they were copied, and a reading that is counted twice looks more exact than it is.
std::vector<char> copied_readings(const Recording& recording) {
  constexpr double most_alike = 0.2;
  const Pairs& p = recording.pairs;
  std::vector<char> copied(p.size());
  std::vector<std::vector<double>> columns{p.true_m};  // the reading last
  for (const std::vector<int>* labels : {&p.landmark, &p.batch, &recording.groups.of})
    if (!labels->empty()) columns.emplace_back(labels->begin(), labels->end());
  for (const std::vector<double>* numbers : {&p.bearing_rad, &p.time_s})
    if (!numbers->empty()) columns.push_back(*numbers);
  for (const auto& [name, values] : p.covariates) {
    columns.push_back(values);
    for (double& value : columns.back())
      if (!std::isfinite(value)) value = std::numeric_limits<double>::max();
  }
  columns.push_back(p.reading_m);
  std::vector<std::size_t> order(p.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto first_difference = [&](std::size_t a, std::size_t b) {
    return std::find_if(columns.begin(), columns.end(), [&](const auto& c) { return c[a] != c[b]; });
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    const auto column = first_difference(a, b);
    return column != columns.end() && (*column)[a] < (*column)[b];
  });
  double originals = 0.0, settings = 0.0;  // what differs in any column; in any but the reading
  for (std::size_t j = 0; j < order.size(); ++j) {
    const auto column = j == 0 ? columns.begin() : first_difference(order[j - 1], order[j]);
    copied[order[j]] = column == columns.end();
    originals += !copied[order[j]];
    settings += column < columns.end() - 1;
  }
  if (settings < (1.0 - most_alike) * originals)
    copied.assign(p.size(), 0);  // rounded readings of one setting
  return copied;
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
  std::vector<Unused> unused;
  for (const Recording& recording : recordings) unused.push_back(unused_covariates(recording));
  const bool estimate = std::any_of(recordings.begin(), recordings.end(),
                                    [](const Recording& r) { return r.estimate_sigma_xy; });
  std::vector<std::vector<MisreadLabel>> misread;
  for (const Recording& recording : recordings) misread.push_back(misread_labels(recording));
  const bool misreads = std::any_of(misread.begin(), misread.end(), [](const auto& m) { return !m.empty(); });
  const bool drops =
      std::any_of(unused.begin(), unused.end(), [](const auto& columns) { return !columns.empty(); });
  const auto any = [&](const auto& marks) {
    return std::any_of(recordings.begin(), recordings.end(), [&](const Recording& r) {
      const std::vector<char> out = marks(r);
      return std::find(out.begin(), out.end(), 1) != out.end();
    });
  };
  if (unseen.empty() && !drops && !misreads && !estimate &&
      !any([](const Recording& r) { return incomplete_readings(r); }) && !any(copied_readings))
    return std::nullopt;
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
  const auto leave_out = [&](const std::vector<char>& out, const char* which, Recording& recording) {
    const auto count = std::count(out.begin(), out.end(), 1);
    if (count == 0) return;
    const auto first = std::find(out.begin(), out.end(), 1) - out.begin();
    const std::vector<int>& row = recording.pairs.row;
    result.notes.push_back(fmt::format("left out, {} {}{}", count, which,
                                       row.empty() ? "" : fmt::format(" (the first in row {})", row[first])));
    leave_out_readings(out, recording);
  };
  for (Recording& recording : result.recordings) {
    leave_out(copied_readings(recording), "row(s) that repeat another one in every column", recording);
    leave_out(incomplete_readings(recording), "reading(s) that lack a value in a column that the others have",
              recording);
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
