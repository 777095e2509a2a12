// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/lookup_table.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <string>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

constexpr std::size_t kIntervals = 1000;  ///< between places where a row may stand

/// The sensor at every place of a row, and midway between these.
struct SampledSensor {
  std::vector<double> distance_m;
  std::vector<SensorReading> reading;

  LookupTable::Row row(std::size_t place) const {
    const SensorReading& at = reading[2 * place];
    return {distance_m[2 * place], at.mean_m, at.std_dev_m / at.mean_m};
  }
};

SensorReading between(const LookupTable::Row& a, const LookupTable::Row& b, double d) {
  const double share = (d - a.distance_m) / (b.distance_m - a.distance_m);
  const double mean = a.mean_m + share * (b.mean_m - a.mean_m);
  return {mean, mean * (a.relative_std_dev + share * (b.relative_std_dev - a.relative_std_dev))};
}

bool may_follow(const SampledSensor& sampled, std::size_t from, std::size_t to, double tolerance) {
  if (to == from + 1) return true;
  const LookupTable::Row a = sampled.row(from), b = sampled.row(to);
  const auto within = [&](std::size_t i) {
    const SensorReading at = between(a, b, sampled.distance_m[i]), truth = sampled.reading[i];
    return std::abs(at.mean_m - truth.mean_m) <= tolerance &&
           std::abs(at.std_dev_m - truth.std_dev_m) <= tolerance;
  };
  if (!within(from + to)) return false;  // the middle, where a smooth curve is furthest off
  for (std::size_t i = 2 * from + 1; i < 2 * to; ++i)
    if (!within(i)) return false;
  return true;
}

}  // namespace

SensorReading LookupTable::at(double d) const {
  if (d <= rows.front().distance_m)
    return {rows.front().mean_m, rows.front().mean_m * rows.front().relative_std_dev};
  if (d >= rows.back().distance_m)
    return {rows.back().mean_m, rows.back().mean_m * rows.back().relative_std_dev};
  const auto above = std::upper_bound(rows.begin(), rows.end(), d,
                                      [](double at, const Row& row) { return at < row.distance_m; });
  return between(*(above - 1), *above, d);
}

LookupTable fewest_rows(const std::function<SensorReading(double)>& sensor, double low_m, double high_m,
                        double tolerance_m) {
  if (!(tolerance_m > 0.0))
    throw InputError("fewest_rows: tolerance " + std::to_string(tolerance_m) + " is not positive");
  if (!(low_m >= 0.0 && high_m > low_m && std::isfinite(high_m)))
    throw InputError("fewest_rows: the distances are not 0 <= low < high");
  SampledSensor sampled;
  for (std::size_t i = 0; i <= 2 * kIntervals; ++i) {
    const double d = low_m + (high_m - low_m) * static_cast<double>(i) / (2.0 * kIntervals);
    sampled.distance_m.push_back(d);
    sampled.reading.push_back(sensor(d));
    if (!(sampled.reading.back().mean_m > 0.0))
      throw InputError("the mean reading at " + std::to_string(d) +
                       " m is not positive, of which a table cannot state relative noise");
  }
  constexpr std::size_t none = kIntervals + 1;
  std::vector<std::size_t> before(kIntervals + 1, none), reached{0};
  while (before[kIntervals] == none) {
    std::vector<std::size_t> next;
    for (const std::size_t from : reached)
      for (std::size_t to = from + 1; to <= kIntervals; ++to)
        if (before[to] == none && may_follow(sampled, from, to, tolerance_m)) {
          before[to] = from;
          next.push_back(to);
        }
    reached = std::move(next);
  }
  LookupTable table;
  for (std::size_t place = kIntervals;; place = before[place]) {
    table.rows.push_back(sampled.row(place));
    if (place == 0) break;
  }
  std::reverse(table.rows.begin(), table.rows.end());
  for (std::size_t i = 0; i < sampled.reading.size(); ++i) {
    const SensorReading at = table.at(sampled.distance_m[i]);
    table.mean_error_m = std::max(table.mean_error_m, std::abs(at.mean_m - sampled.reading[i].mean_m));
    table.std_dev_error_m =
        std::max(table.std_dev_error_m, std::abs(at.std_dev_m - sampled.reading[i].std_dev_m));
  }
  return table;
}

}  // namespace rangecal
