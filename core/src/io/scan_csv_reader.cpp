// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>

#include "io/csv_fields.hpp"
#include "io/scan_readers.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"
#include "rangecal/core/utf8.hpp"

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

/// One line, and which of its fields was asked for last.
struct WideLine {
  std::vector<std::string_view> fields;
  const std::string& file;
  int row;
  std::size_t at = 0;

  [[noreturn]] void ends_too_soon() {
    at = fields.size();
    throw InputError(file, row, "", "holds " + std::to_string(fields.size()) + " fields and no range");
  }
  double number(std::size_t field, bool beam, const std::string& column) {
    at = field;
    if (field >= fields.size()) ends_too_soon();
    return number_in(fields[field], beam, file, row, column);
  }
  /// True where it went wrong at the end of the line: in its last field, or behind it.
  bool failed_at_end() const { return at + 1 >= fields.size(); }
};

Scan wide_scan(WideLine& line, const WideColumns& columns) {
  Scan scan;
  scan.row = line.row;
  scan.stamp_s = line.number(columns.stamp, false, "stamp");
  const double angle_min = line.number(columns.angle_min, false, "angle_min");
  const double increment = line.number(columns.increment, false, "angle_increment");
  const double stated = columns.count ? line.number(*columns.count, false, "n") : 0.0;
  if (line.fields.size() <= columns.first_range) line.ends_too_soon();
  if (columns.stop) scan.stop = std::string(line.fields[*columns.stop]);
  std::vector<double> ranges;
  for (std::size_t i = columns.first_range; i < line.fields.size(); ++i)
    ranges.push_back(line.number(i, true, "range " + std::to_string(i - columns.first_range)));
  if (columns.count && stated != static_cast<double>(ranges.size())) {
    line.at = stated > static_cast<double>(ranges.size()) ? line.fields.size() : *columns.count;
    throw InputError(line.file, line.row, "n",
                     "says " + std::string(line.fields[*columns.count]) + " beams, the line holds " +
                         std::to_string(ranges.size()));
  }
  line.at = columns.increment;
  set_beams(scan, angle_min, increment, std::move(ranges), line.file);
  return scan;
}

/// A last line without its end is torn where it has fewer beams than it states, or than any scan before it, or where its last
/// field is no number; a number that lacks digits cannot be told. The first scan is whole, or an error.
ScanLog read_wide(const std::string& path, Lines lines, const WideColumns& columns) {
  ScanLog log{path, "CSV, one scan a line", {}, 0};
  std::size_t fewest = std::numeric_limits<std::size_t>::max();
  for (std::string_view text; lines.next(text);) {
    if (text.find_first_not_of(" \t,") == std::string_view::npos) continue;
    WideLine line{comma_fields(text), path, lines.number()};
    const bool may_be_torn = !lines.had_end() && !log.scans.empty();
    bool torn = false;
    try {
      Scan scan = wide_scan(line, columns);
      torn = may_be_torn && scan.size() < fewest && !columns.count;
      fewest = std::min(fewest, scan.size());
      if (!torn) log.scans.push_back(std::move(scan));
    } catch (const InputError&) {
      torn = may_be_torn && line.failed_at_end();
      if (!torn) throw;
    }
    if (torn) log.warning = last_line_left_out(path, lines.number(), torn_line);
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

struct LongColumns {
  std::size_t stamp, angle, range;
  std::optional<std::size_t> stop;

  explicit LongColumns(const CsvTable& table)
      : stamp(table.require("stamp")),
        angle(table.require("angle_rad")),
        range(table.require("range_m")),
        stop(table.find("stop")) {}
};

ScanLog long_scans(const CsvTable& table) {
  const LongColumns columns(table);
  ScanLog log{table.file(), "CSV, one beam a line", {}, 0};
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const double at = table.finite(row, columns.stamp), bearing = table.finite(row, columns.angle);
    const std::string label = columns.stop ? std::string(table.text(row, *columns.stop)) : "";
    if (std::abs(bearing) > 4.0 * std::numbers::pi)
      table.fail(row, columns.angle,
                 "'" + std::string(table.text(row, columns.angle)) +
                     "' is more than two turns: degrees, most likely");
    if (log.scans.empty() || log.scans.back().stamp_s != at || log.scans.back().stop != label) {
      Scan scan;
      scan.stamp_s = at, scan.stop = label, scan.row = table.line(row);
      log.scans.push_back(std::move(scan));
    }
    log.scans.back().bearing_rad.push_back(bearing);
    log.scans.back().range_m.push_back(table.number(row, columns.range).value_or(std::nan("")));
  }
  for (Scan& scan : log.scans) sort_beams(scan);
  return log;
}

/// The last line of a file of beams, where it has no end: its last field may be a part of one, all others are whole.
class TornBeam {
 public:
  TornBeam(const CsvTable& before, std::string_view line)
      : columns_(before), width_(before.columns().size()) {
    if (std::count(line.begin(), line.end(), '"') % 2 == 1) line = line.substr(0, line.find('"'));
    if (line.ends_with('\r')) line.remove_suffix(1);
    fields_ = comma_fields(line);
  }

  /// Too few fields, or a last one that is no number: what stands before it is in order.
  bool is_cut() const {
    if (fields_.size() > width_) return false;
    const std::size_t last = fields_.size() - 1;
    for (std::size_t i = 0; i < last; ++i)
      if (!is_in_order(i)) return false;
    return fields_.size() < width_ || !is_in_order(last);
  }

  /// False where a whole field says that it begins another scan.
  bool may_be_of(const Scan& scan) const {
    double at = 0.0;
    if (!is_whole(columns_.stamp)) return true;
    if (parse_number(fields_[columns_.stamp], at) != Parsed::number || at != scan.stamp_s) return false;
    if (!columns_.stop || !is_whole(*columns_.stop)) return true;
    const std::string_view label = fields_[*columns_.stop];
    return label == scan.stop || label.starts_with('"');
  }

 private:
  bool is_whole(std::size_t field) const { return field + 1 < fields_.size(); }
  bool is_in_order(std::size_t field) const {
    if (field != columns_.stamp && field != columns_.angle && field != columns_.range) return true;
    double value = 0.0;
    const Parsed parsed = parse_number(fields_[field], value);
    if (field == columns_.range) return parsed == Parsed::number || parsed == Parsed::empty;
    return parsed == Parsed::number && std::isfinite(value);
  }

  LongColumns columns_;
  std::size_t width_;
  std::vector<std::string_view> fields_;
};

/// A last line without its end is torn where fields lack, or its last one is no number, or where it would be a scan of its
/// own: a label or a time was cut short then. The scan that it is of lacks beams and is left out with it. The first scan is
/// whole, or an error.
ScanLog read_long(const std::string& path, const std::string& text) {
  const std::size_t last = text.rfind('\n') + 1;  // 0: there is but one line
  const std::string_view line = std::string_view(text).substr(last);
  if (last == 0 || line.find_first_not_of(" \t\r") == std::string_view::npos)
    return long_scans(CsvTable::parse(text, path));
  const CsvTable before = CsvTable::parse(text.substr(0, last), path);
  ScanLog log = long_scans(before);
  const TornBeam torn(before, line);
  const bool with_its_scan = !log.scans.empty() && torn.may_be_of(log.scans.back());
  const bool leaves_a_scan = log.scans.size() > (with_its_scan ? 1u : 0u);
  try {
    ScanLog whole = long_scans(CsvTable::parse(text, path));
    if (!leaves_a_scan || whole.scans.size() == log.scans.size()) return whole;
  } catch (const InputError&) {
    if (!leaves_a_scan || !torn.is_cut()) throw;
  }
  if (with_its_scan) log.scans.pop_back();
  const auto row = static_cast<int>(1 + std::count(text.begin(), text.end(), '\n'));
  log.warning =
      last_line_left_out(path, row, torn_line) + (with_its_scan ? " with the scan that it is of" : "");
  return log;
}

}  // namespace

ScanLog read_csv_scans(const std::string& path, const std::string& text) {
  std::string_view all(text), line;
  if (all.starts_with(byte_order_mark)) all.remove_prefix(byte_order_mark.size());
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
