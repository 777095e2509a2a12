// SPDX-License-Identifier: BSD-3-Clause
#include "track/columns.hpp"

#include <utility>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/core/utf8.hpp"
#include "track/line_source.hpp"

namespace rangecal::app {
namespace {

std::string trimmed(std::string field) {
  const std::size_t begin = field.find_first_not_of(' ');
  if (begin == std::string::npos) return "";
  return field.substr(begin, field.find_last_not_of(' ') + 1 - begin);
}

/// Name, field of the columns and of the row, of everything that is a number.
template <typename Do>
void for_numbers(const Columns& c, StreamRow& row, Do&& each) {
  each("reading_m", c.reading, row.reading_m);
  each("true_m", c.truth, row.true_m);
  each("time_s", c.time, row.time_s);
  each("bearing_rad", c.bearing, row.bearing_rad);
  each("x_m", c.pose[0], row.pose[0]);
  each("y_m", c.pose[1], row.pose[1]);
  each("heading_rad", c.pose[2], row.pose[2]);
  each("sigma_xy_m", c.sigma_xy, row.sigma_xy_m);
  each("sigma_heading_rad", c.sigma_heading, row.sigma_heading_rad);
  each("radius_m", c.radius, row.radius_m);
  for (std::size_t i = 0; i < c.covariance.size(); ++i)
    each(covariance_columns[i], c.covariance[i], row.covariance[i]);
}

}  // namespace

Columns columns_of(const std::string& header, const std::string& file, long line) {
  if (first_bad_byte(header) != std::string::npos) throw InputError(file, line, "", "is not UTF-8 text");
  const auto fields = csv_fields(header);
  if (!fields) throw InputError(file, line, "", "a quote is left open");
  Columns columns;
  columns.reading = -1;
  columns.count = fields->size();
  const std::pair<const char*, int*> known[] = {{"true_m", &columns.truth},
                                                {"time_s", &columns.time},
                                                {"bearing_rad", &columns.bearing},
                                                {"stop", &columns.stop},
                                                {"landmark", &columns.landmark},
                                                {"place", &columns.place},
                                                {"x_m", &columns.pose[0]},
                                                {"y_m", &columns.pose[1]},
                                                {"heading_rad", &columns.pose[2]},
                                                {"sigma_xy_m", &columns.sigma_xy},
                                                {"sigma_heading_rad", &columns.sigma_heading},
                                                {"radius_m", &columns.radius}};
  for (std::size_t i = 0; i < fields->size(); ++i) {
    std::string field = (*fields)[i];
    if (i == 0 && field.starts_with("\xEF\xBB\xBF")) field.erase(0, 3);
    field = trimmed(field);
    const int at = static_cast<int>(i);
    if (field == "reading_m" || (field == "range_m" && columns.reading < 0)) columns.reading = at;
    for (const auto& [name, column] : known)
      if (field == name) *column = at;
    for (std::size_t k = 0; k < columns.covariance.size(); ++k)
      if (field == covariance_columns[k]) columns.covariance[k] = at;
  }
  if (columns.reading < 0)
    throw InputError(file, line, "",
                     "there is no column reading_m or range_m, and the first line is no number; columns are "
                     "separated by commas");
  if (columns.truth >= 0)
    columns.stop = columns.landmark = -1;  // known distances: pairs, whatever else there is
  if (columns.landmarks() && columns.bearing < 0)
    throw InputError(file, line, "bearing_rad", "is missing: readings of landmarks need it");
  return columns;
}

BadField read_row(const Columns& columns, const std::vector<std::string>& fields, StreamRow& row) {
  row = {};
  BadField bad;
  for_numbers(columns, row, [&](const char* name, int column, double& value) {
    if (column < 0 || !bad.what.empty()) return;
    const std::string& text = fields[static_cast<std::size_t>(column)];
    if (text.find_first_not_of(" \t\r") == std::string::npos || text == "NA") return;
    const auto read = number_of(text);
    if (!read) bad = {name, "'" + text + "' is not a number"};
    value = read.value_or(value);
  });
  const auto label = [&](int column) {
    return column < 0 ? "" : trimmed(fields[static_cast<std::size_t>(column)]);
  };
  row.stop = label(columns.stop);
  row.landmark = label(columns.landmark);
  row.place = label(columns.place);
  return bad;
}

}  // namespace rangecal::app
