// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <numbers>

#include "io/scan_readers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/scan_io.hpp"
#include "rangecal/core/utf8.hpp"

namespace rangecal {
namespace io {
namespace {

constexpr std::size_t kLongestLine = std::size_t{16} << 20;

}  // namespace

bool Lines::next(std::string_view& line) {
  if (rest_.empty()) return false;
  const std::size_t end = rest_.find('\n');
  line = rest_.substr(0, end);
  if (line.size() > kLongestLine) throw InputError(file_, number_ + 1, "", "is longer than 16 MB");
  had_end_ = end != std::string_view::npos;
  rest_.remove_prefix(had_end_ ? end + 1 : rest_.size());
  if (!line.empty() && line.back() == '\r') line.remove_suffix(1);
  ++number_;
  return true;
}

std::vector<std::string_view> comma_fields(std::string_view line) {
  const auto trimmed = [](std::string_view text) {
    const std::size_t first = text.find_first_not_of(" \t");
    if (first == std::string_view::npos) return std::string_view{};
    return text.substr(first, text.find_last_not_of(" \t") - first + 1);
  };
  std::vector<std::string_view> fields;
  for (std::size_t at = 0;;) {
    const std::size_t comma = line.find(',', at);
    fields.push_back(trimmed(line.substr(at, comma == std::string_view::npos ? comma : comma - at)));
    if (comma == std::string_view::npos) return fields;
    at = comma + 1;
  }
}

std::vector<std::string_view> word_fields(std::string_view line) {
  std::vector<std::string_view> fields;
  for (std::size_t at = line.find_first_not_of(" \t"); at != std::string_view::npos;) {
    const std::size_t end = line.find_first_of(" \t", at);
    fields.push_back(line.substr(at, end == std::string_view::npos ? end : end - at));
    at = end == std::string_view::npos ? end : line.find_first_not_of(" \t", end);
  }
  return fields;
}

double number_in(std::string_view field, bool beam, const std::string& file, int row,
                 const std::string& column) {
  double value = 0.0;
  if (field.empty() && beam) return std::numeric_limits<double>::quiet_NaN();
  const auto [end, code] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (code != std::errc() || end != field.data() + field.size()) {
    const std::string shown(field.substr(0, 40));
    throw InputError(file, row, column, field.empty() ? "is empty" : "'" + shown + "' is not a number");
  }
  if (!beam && !std::isfinite(value))
    throw InputError(file, row, column, "'" + std::string(field) + "' is not finite");
  return value;
}

std::string last_line_left_out(const std::string& path, int row, const std::string& why) {
  return path + ", row " + std::to_string(row) + ": the last line " + why + ", and is left out";
}

namespace {

bool looks_like_carmen(std::string_view text, const std::string& file) {
  Lines lines(text, file);
  for (std::string_view line; lines.next(line) && lines.number() < 1000;) {
    for (const char* start : {"FLASER ", "RAWLASER", "ROBOTLASER", "PARAM ", "ODOM ", "SYNC "})
      if (line.starts_with(start)) return true;
  }
  return false;
}

}  // namespace
}  // namespace io

void set_beams(Scan& scan, double angle_min, double increment, std::vector<double> ranges,
               const std::string& file) {
  const double turn = 2.0 * std::numbers::pi;
  if (increment == 0.0 || !std::isfinite(increment))
    throw InputError(file, scan.row, "angle_increment",
                     "the step from beam to beam must be a number other than 0");
  const double swept = std::abs(increment) * static_cast<double>(ranges.size());
  if (std::abs(increment) >= 1.0 || swept > 2.0 * turn)
    throw InputError(
        file, scan.row, "angle_increment",
        "beams sweep " + std::to_string(swept) + " rad: degrees, most likely; convert to radians");
  const std::size_t count = ranges.size();
  scan.bearing_rad.resize(count);
  for (std::size_t i = 0; i < count; ++i)
    scan.bearing_rad[i] = angle_min + static_cast<double>(i) * increment;
  scan.range_m = std::move(ranges);
  if (increment < 0.0) {
    std::reverse(scan.bearing_rad.begin(), scan.bearing_rad.end());
    std::reverse(scan.range_m.begin(), scan.range_m.end());
  }
}

ScanLog read_scans(const std::string& given) {
  const bool from_stdin = given == "-";
  const std::string text = read_file(from_stdin ? "/dev/stdin" : given), path = from_stdin ? "stdin" : given;
  if (text.starts_with("#ROSBAG"))
    throw InputError(
        path, 0, "",
        from_stdin ? "is a ROS 1 bag, which is read from a file only" : "is a ROS 1 bag, not text");
  if (text.starts_with("\x89MCAP") || text.starts_with("SQLite format 3"))
    throw InputError(path, 0, "", "is a bag of ROS 2, which is read from a file only");
  if (const std::size_t bad = first_bad_byte(text); bad != std::string::npos)
    throw InputError(path,
                     1 + std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(bad), '\n'), "",
                     "is not UTF-8 text");
  ScanLog log =
      io::looks_like_carmen(text, path) ? io::read_carmen_log(path, text) : io::read_csv_scans(path, text);
  if (log.scans.empty()) throw InputError(path, 0, "", "holds no scan");
  return log;
}

}  // namespace rangecal
