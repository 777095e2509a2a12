// SPDX-License-Identifier: BSD-3-Clause
#include "track/columns.hpp"

#include <algorithm>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"
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
  const CsvTable table = CsvTable::parse(header, file);
  const auto at = [&](const char* name) {
    const auto found = table.optional(name);
    return found ? static_cast<int>(*found) : -1;
  };
  Columns c;
  c.count = table.columns().size();
  c.reading = at("reading_m");
  if (c.reading < 0) c.reading = at("range_m");
  if (c.reading < 0)
    throw InputError(file, line, "",
                     "there is no column reading_m or range_m, and the first line is no number; columns are "
                     "separated by commas");
  c.truth = at("true_m");
  c.time = at("time_s");
  c.bearing = at("bearing_rad");
  if (c.truth >= 0) return c;  // known distances: pairs, whatever else there is
  c.stop = at("stop");
  c.landmark = at("landmark");
  if (!c.landmarks()) return c;
  c.place = at("place");
  c.pose = {at("x_m"), at("y_m"), at("heading_rad")};
  c.sigma_xy = at("sigma_xy_m");
  c.sigma_heading = at("sigma_heading_rad");
  c.radius = at("radius_m");
  for (std::size_t k = 0; k < c.covariance.size(); ++k) c.covariance[k] = at(covariance_columns[k]);
  if (c.bearing < 0) throw InputError(file, line, "bearing_rad", "is missing: readings of landmarks need it");
  return c;
}

bool names_columns(const std::string& line) {
  if (line.find('_') == std::string::npos) return false;  // most rows: no time is lost on them
  const auto fields = csv_fields(line);
  return fields && std::any_of(fields->begin(), fields->end(), [](const std::string& field) {
           const std::string name = trimmed(field);
           return name == "reading_m" || name == "range_m" || name == "true_m" || name == "time_s" ||
                  name == "bearing_rad";
         });
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
