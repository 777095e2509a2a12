// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <cstddef>
#include <limits>
#include <string>
#include <tuple>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/world/scene_recording.hpp"

namespace rangecal {

/// The readings of one cell or batch, sorted into those that the sensor reports and those lost, and why.
class CellFilter {
 public:
  CellFilter(const Sensor& sensor, Counts& counts,
             double lost_beyond_m = std::numeric_limits<double>::infinity())
      : sensor_(sensor), counts_(counts), lost_beyond_m_(lost_beyond_m) {}

  void add(double range_m, double bearing_rad) {
    ++counts_.read;
    if (!std::isfinite(range_m)) {
      ++counts_.dropped["not finite"];
    } else if (range_m == 0.0) {
      ++counts_.dropped["zero"];
    } else if (range_m < 0.0) {
      ++counts_.dropped["negative"];
    } else if (range_m > lost_beyond_m_) {
      ++counts_.dropped["lost to dropout"];
    } else if (range_m < sensor_.range_min_m) {
      ++counts_.dropped["below range_min_m"];
      ++lost_;
    } else if (range_m > sensor_.range_max_m) {
      ++counts_.dropped["above range_max_m"];
      ++lost_;
    } else {
      kept_.emplace_back(repeat_, range_m, bearing_rad);
    }
    ++repeat_;
  }

  /// Hands every reading that may be used to `use(repeat, range, bearing)`.
  template <typename Use>
  void finish(Use use) {
    const auto kept = static_cast<int>(kept_.size());
    if (100 * lost_ > kept + lost_) {
      ++counts_.cells_left_out;
      if (kept > 0) counts_.dropped["cell cut by a limit"] += kept;
      return;
    }
    counts_.used += kept;
    for (const auto& [repeat, range_m, bearing_rad] : kept_) use(repeat, range_m, bearing_rad);
  }

 private:
  const Sensor& sensor_;
  Counts& counts_;
  double lost_beyond_m_;
  int repeat_ = 0, lost_ = 0;
  std::vector<std::tuple<int, double, double>> kept_;
};

/// Writes what is reported into the recording, with rows and times.
class Reporter {
 public:
  Reporter(const Scene& scene, Recording& recording)
      : sweep_s_(scene.timing ? scene.timing->sweep_s : 0.0),
        starts_s_(start_times_s(scene)),
        recording_(recording) {}

  /// The readings of landmark l from stop k.
  void report_cell(std::size_t k, std::size_t l, CellFilter& filter) {
    Readings& readings = recording_.readings;
    filter.finish([&](int repeat, double range_m, double bearing_rad) {
      readings.stop.push_back(static_cast<int>(k));
      readings.landmark.push_back(static_cast<int>(l));
      readings.repeat.push_back(repeat);
      if (!starts_s_.empty()) readings.time_s.push_back(starts_s_[k] + repeat * sweep_s_);
      readings.range_m.push_back(range_m);
      readings.bearing_rad.push_back(bearing_rad);
      readings.row.push_back(line_++);
    });
  }

  /// Those of batch b at distance true_m.
  void report_batch(std::size_t b, double true_m, CellFilter& filter) {
    Pairs& pairs = recording_.pairs;
    const auto index = static_cast<int>(pairs.batch_labels.size());
    filter.finish([&](int repeat, double range_m, double) {
      if (static_cast<int>(pairs.batch_labels.size()) == index)
        pairs.batch_labels.push_back(std::to_string(b));
      pairs.batch.push_back(index);
      pairs.true_m.push_back(true_m);
      if (!starts_s_.empty()) pairs.time_s.push_back(starts_s_[b] + repeat * sweep_s_);
      pairs.reading_m.push_back(range_m);
      pairs.row.push_back(line_++);
    });
  }

 private:
  double sweep_s_;
  std::vector<double> starts_s_;
  Recording& recording_;
  int line_ = 2;
};

}  // namespace rangecal
