// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <numbers>
#include <numeric>
#include <optional>

#include "io/scan_readers.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"

namespace rangecal::io {
namespace {

/// Where the columns of a one-scan-a-line file stand; ranges run from `first_range` to the end of the line.
struct WideColumns {
  std::size_t stamp = 0, angle_min = 0, increment = 0, first_range = 0;
  std::optional<std::size_t> count, stop;
};

std::optional<WideColumns> wide_columns(const std::vector<std::string_view>& header) {
  const auto find = [&](std::string_view name) -> std::optional<std::size_t> {
    const auto found = std::find(header.begin(), header.end(), name);
    if (found == header.end()) return std::nullopt;
    return static_cast<std::size_t>(found - header.begin());
  };
  const auto stamp = find("stamp"), angle_min = find("angle_min"), increment = find("angle_increment");
  if (!stamp || !angle_min || !increment) return std::nullopt;
  WideColumns columns{*stamp, *angle_min, *increment, 0, find("n"), find("stop")};
  for (const auto& column : {stamp, angle_min, increment, columns.count, columns.stop})
    if (column) columns.first_range = std::max(columns.first_range, *column + 1);
  return columns;
}

ScanLog read_wide(const std::string& path, Lines lines, const WideColumns& columns) {
  ScanLog log{path, "CSV, one scan a line", {}, 0};
  for (std::string_view line; lines.next(line);) {
    if (line.find_first_not_of(" \t,") == std::string_view::npos) continue;
    const auto fields = comma_fields(line);
    const int row = lines.number();
    if (fields.size() <= columns.first_range)
      throw InputError(path, row, "", "holds " + std::to_string(fields.size()) + " fields and no range");
    Scan scan;
    scan.row = row;
    scan.stamp_s = number_in(fields[columns.stamp], false, path, row, "stamp");
    const double angle_min = number_in(fields[columns.angle_min], false, path, row, "angle_min");
    const double increment = number_in(fields[columns.increment], false, path, row, "angle_increment");
    if (columns.stop) scan.stop = std::string(fields[*columns.stop]);
    std::vector<double> ranges;
    for (std::size_t i = columns.first_range; i < fields.size(); ++i)
      ranges.push_back(
          number_in(fields[i], true, path, row, "range " + std::to_string(i - columns.first_range)));
    if (columns.count) {
      const double stated = number_in(fields[*columns.count], false, path, row, "n");
      if (stated != static_cast<double>(ranges.size()))
        throw InputError(path, row, "n",
                         "says " + std::string(fields[*columns.count]) + " beams, the line holds " +
                             std::to_string(ranges.size()));
    }
    set_beams(scan, angle_min, increment, std::move(ranges), path);
    log.scans.push_back(std::move(scan));
  }
  return log;
}

/// Beams in the order of increasing bearing.
void sort_beams(Scan& scan) {
  std::vector<std::size_t> order(scan.size());
  std::iota(order.begin(), order.end(), 0);
  std::stable_sort(order.begin(), order.end(),
                   [&](std::size_t a, std::size_t b) { return scan.bearing_rad[a] < scan.bearing_rad[b]; });
  const Scan given = scan;
  for (std::size_t i = 0; i < order.size(); ++i) {
    scan.bearing_rad[i] = given.bearing_rad[order[i]];
    scan.range_m[i] = given.range_m[order[i]];
  }
}

ScanLog read_long(const std::string& path, const std::string& text) {
  const CsvTable table = CsvTable::parse(text, path);
  const std::size_t stamp = table.require("stamp"), angle = table.require("angle_rad"),
                    range = table.require("range_m");
  const auto stop = table.find("stop");
  ScanLog log{path, "CSV, one beam a line", {}, 0};
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const double at = table.finite(row, stamp), bearing = table.finite(row, angle);
    const std::string label = stop ? std::string(table.text(row, *stop)) : "";
    if (std::abs(bearing) > 4.0 * std::numbers::pi)
      table.fail(
          row, angle,
          "'" + std::string(table.text(row, angle)) + "' is more than two turns: degrees, most likely");
    if (log.scans.empty() || log.scans.back().stamp_s != at || log.scans.back().stop != label) {
      Scan scan;
      scan.stamp_s = at, scan.stop = label, scan.row = table.line(row);
      log.scans.push_back(std::move(scan));
    }
    log.scans.back().bearing_rad.push_back(bearing);
    log.scans.back().range_m.push_back(table.number(row, range).value_or(std::nan("")));
  }
  for (Scan& scan : log.scans) sort_beams(scan);
  return log;
}

}  // namespace

ScanLog read_csv_scans(const std::string& path, const std::string& text) {
  std::string_view all(text), line;
  if (all.starts_with("\xef\xbb\xbf")) all.remove_prefix(3);
  Lines lines(all, path);
  if (!lines.next(line)) throw InputError(path, 0, "", "is empty");
  const auto header = comma_fields(line);
  if (const auto columns = wide_columns(header)) return read_wide(path, lines, *columns);
  if (std::find(header.begin(), header.end(), "angle_rad") != header.end()) return read_long(path, text);
  throw InputError(path, 1, "",
                   "is no file of scans: a CSV needs the columns stamp, angle_min, angle_increment and "
                   "ranges, or stamp, angle_rad and range_m; a CARMEN log lines such as FLASER");
}

}  // namespace rangecal::io
