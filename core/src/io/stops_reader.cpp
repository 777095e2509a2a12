// SPDX-License-Identifier: BSD-3-Clause
#include <utility>

#include "io/recording_parts.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal {
namespace {

constexpr std::size_t most_stops = 1'000'000;

std::optional<double> optional_sigma(const CsvTable& table, std::size_t row,
                                     std::optional<std::size_t> column) {
  if (!column || !table.number(row, *column)) return std::nullopt;
  const double sigma = table.finite(row, *column);
  if (sigma < 0.0) table.fail(row, *column, "is negative");
  return sigma;
}

/// The covariance of a row in place of the sigmas that the stop has.
void take_covariance(const CsvTable& table, std::size_t row,
                     const std::array<std::optional<std::size_t>, covariance_columns.size()>& columns,
                     double sigma_heading_rad, Stop& stop) {
  CovarianceEntries entries;
  std::size_t given = covariance_columns.size();
  for (std::size_t i = covariance_columns.size(); i-- > 0;)
    if (columns[i] && table.number(row, *columns[i])) {
      entries[i] = table.finite(row, *columns[i]);
      given = i;
    }
  if (given == covariance_columns.size()) return;
  const StopCovariance covariance =
      stop_covariance(entries, stop.sigma_heading_rad.value_or(sigma_heading_rad));
  if (!covariance.fault.empty()) {
    if (!columns[covariance.at])
      table.require(covariance_columns[covariance.at]);  // says that there is no such column
    table.fail(row, *columns[covariance.at], covariance.fault);
  }
  if (stop.sigma_xy_m) table.fail(row, *columns[0], "stands beside a sigma_xy_m: one of them has to go");
  if (entries[3] && stop.sigma_heading_rad)
    table.fail(row, *columns[3], "stands beside a sigma_heading_rad: one of them has to go");
  stop.covariance = covariance.matrix;
  stop.sigma_heading_rad.reset();
}

}  // namespace

std::vector<Stop> stops_of(const CsvTable& table, double sigma_heading_rad) {
  const std::size_t label = table.require("stop");
  const std::size_t x = table.require("x_m"), y = table.require("y_m"),
                    heading = table.require("heading_rad");
  const auto sigma_xy = table.optional("sigma_xy_m"), sigma_heading = table.optional("sigma_heading_rad");
  const auto place = table.optional("place");
  std::array<std::optional<std::size_t>, covariance_columns.size()> covariance;
  for (std::size_t i = 0; i < covariance.size(); ++i) covariance[i] = table.find(covariance_columns[i]);
  if (table.rows() == 0) throw InputError(table.file(), 0, "", "holds a header and no rows");

  std::vector<Stop> stops;
  io::LabelIndex index;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Stop stop;
    stop.label = table.label(row, label);
    if (stops.size() == most_stops)
      table.fail(row, label, "there are more than " + std::to_string(most_stops) + " stops");
    if (index.find(stop.label)) table.fail(row, label, "stop '" + stop.label + "' is listed twice");
    stop.commanded.x_m = table.finite(row, x);
    stop.commanded.y_m = table.finite(row, y);
    stop.commanded.heading_rad = io::checked_angle(table, row, heading, table.finite(row, heading));
    stop.sigma_xy_m = optional_sigma(table, row, sigma_xy);
    stop.sigma_heading_rad = optional_sigma(table, row, sigma_heading);
    take_covariance(table, row, covariance, sigma_heading_rad, stop);
    if (place && !table.text(row, *place).empty()) stop.place = table.label(row, *place);
    index.insert(stop.label);
    stops.push_back(std::move(stop));
  }
  return stops;
}

}  // namespace rangecal
