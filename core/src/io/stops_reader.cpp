// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal {
namespace {

constexpr std::size_t most_stops = 1'000'000;

std::optional<double> optional_sigma(const CsvTable& table, std::size_t row, std::optional<std::size_t> column) {
  if (!column || !table.number(row, *column)) return std::nullopt;
  const double sigma = table.finite(row, *column);
  if (sigma < 0.0) table.fail(row, *column, "is negative");
  return sigma;
}

}  // namespace

std::vector<Stop> stops_of(const CsvTable& table) {
  const std::size_t label = table.require("stop");
  const std::size_t x = table.require("x_m"), y = table.require("y_m"), heading = table.require("heading_rad");
  const auto sigma_xy = table.find("sigma_xy_m"), sigma_heading = table.find("sigma_heading_rad");
  const auto place = table.find("place");
  if (table.rows() == 0) throw InputError(table.file(), 0, "", "holds a header and no rows");

  std::vector<Stop> stops;
  io::LabelIndex index;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Stop stop;
    stop.label = table.label(row, label);
    if (stops.size() == most_stops) table.fail(row, label, "there are more than " + std::to_string(most_stops) + " stops");
    if (index.find(stop.label)) table.fail(row, label, "stop '" + stop.label + "' is listed twice");
    stop.commanded.x_m = table.finite(row, x);
    stop.commanded.y_m = table.finite(row, y);
    stop.commanded.heading_rad = io::checked_angle(table, row, heading, table.finite(row, heading));
    stop.sigma_xy_m = optional_sigma(table, row, sigma_xy);
    stop.sigma_heading_rad = optional_sigma(table, row, sigma_heading);
    if (place && !table.text(row, *place).empty()) stop.place = table.label(row, *place);
    index.insert(stop.label);
    stops.push_back(std::move(stop));
  }
  return stops;
}

}  // namespace rangecal
