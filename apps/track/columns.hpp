// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

namespace rangecal::app {

/// Which fields of a stream's lines hold what; -1 where there is no such column. Without a header the one
/// field of a line is the reading.
struct Columns {
  int reading = 0, truth = -1, time = -1, bearing = -1;
  int stop = -1, landmark = -1, place = -1;
  /// x_m, y_m, heading_rad of the stop; sigma_xy_m, sigma_heading_rad of the stop; radius_m of the landmark.
  std::array<int, 3> pose{-1, -1, -1};
  int sigma_xy = -1, sigma_heading = -1, radius = -1;
  std::array<int, 6> covariance{-1, -1, -1, -1, -1, -1};  ///< of the stop, in the order of covariance_columns
  std::size_t count = 1;

  /// Readings of landmarks in unknown places, not pairs.
  bool landmarks() const { return stop >= 0 && landmark >= 0; }
  bool operator==(const Columns&) const = default;
};

/// From the header: reading_m or range_m, true_m, time_s, bearing_rad; or range_m, bearing_rad, stop,
/// landmark and what is known of them. Throws InputError naming file and line where no column holds the
/// reading, one is named twice, or has such a name but for capitals or the unit (time_ms): left alone, it would
/// change what the others mean.
Columns columns_of(const std::string& header, const std::string& file, long line);

/// True for a line that is a header, as a program writes it again when it starts again.
bool names_columns(const std::string& line);

/// One row of a stream; NaN and empty where there is nothing.
struct StreamRow {
  double reading_m = std::nan(""), true_m = std::nan(""), time_s = std::nan(""), bearing_rad = std::nan("");
  std::string stop, landmark, place;
  std::array<double, 3> pose{std::nan(""), std::nan(""), std::nan("")};
  double sigma_xy_m = std::nan(""), sigma_heading_rad = std::nan(""), radius_m = std::nan("");
  std::array<double, 6> covariance{std::nan(""), std::nan(""), std::nan(""),
                                   std::nan(""), std::nan(""), std::nan("")};
};

/// The numbers of a row in its fields. Names the column and the text that is none; empty where all is well.
struct BadField {
  std::string column, what;
};
BadField read_row(const Columns& columns, const std::vector<std::string>& fields, StreamRow& row);

}  // namespace rangecal::app
