// SPDX-License-Identifier: BSD-3-Clause
#include <cmath>
#include <limits>
#include <map>
#include <numbers>
#include <optional>

#include "io/scan_readers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/scan_io.hpp"

namespace rangecal::io {
namespace {

/// The words of one message, taken from the front.
struct Words {
  const std::vector<std::string_view>& fields;
  const std::string& file;
  int row;
  std::size_t at = 1;    ///< behind the name of the message
  bool ran_out = false;  ///< more were asked for than there are

  double number(const char* what) {
    ran_out = used_up();
    if (ran_out)
      throw InputError(file, row, what, "the line ends after " + std::to_string(fields.size()) + " words");
    return number_in(fields[at++], false, file, row, what);
  }
  std::size_t count(const char* what) {
    const double value = number(what);
    if (!(value >= 0.0) || value != std::floor(value) || value > 1e6)
      throw InputError(file, row, what, "'" + std::string(fields[at - 1]) + "' is no number of beams");
    return static_cast<std::size_t>(value);
  }
  bool used_up() const { return at >= fields.size(); }
  std::size_t left() const { return fields.size() - at; }
  Pose2 pose(const char* what) {
    Pose2 pose;
    pose.x_m = number(what), pose.y_m = number(what), pose.heading_rad = number(what);
    return pose;
  }
};

/// `count` readings; one at or beyond `limit` is no return.
std::vector<double> readings(Words& words, std::size_t count, double limit) {
  std::vector<double> ranges(count);
  for (double& range : ranges) {
    range = words.number("range");
    if (limit > 0.0 && range >= limit) range = std::numeric_limits<double>::infinity();
  }
  return ranges;
}

/// FLASER n r1 .. rn  x y theta  odom_x odom_y odom_theta  time host time: half a circle, ahead.
void read_flaser(Words& words, Scan& scan) {
  const std::size_t count = words.count("number of readings");
  if (count < 2) throw InputError(words.file, words.row, "number of readings", "is below 2");
  std::vector<double> ranges = readings(words, count, 80.0);
  const double half = 0.5 * std::numbers::pi;
  // 181 and 361 beams include both ends of the half circle; 180 and 360 do not include the last.
  const double steps = static_cast<double>(count % 2 == 1 ? count - 1 : count);
  set_beams(scan, -half, 2.0 * half / steps, std::move(ranges), words.file);
  words.pose("laser pose");
  scan.odometry = words.pose("odometry pose");
  scan.stamp_s = words.number("time");
}

/// RAWLASERn, ROBOTLASERn type start fov resolution max accuracy mode n r1 .. rn m remission1 .. ; the latter then
/// laser pose, robot pose, five more; both time host time.
void read_newer(Words& words, bool robot, Scan& scan) {
  words.number("laser type");
  const double start = words.number("start angle");
  words.number("field of view");
  const double resolution = words.number("angular resolution"), limit = words.number("maximum range");
  words.number("accuracy"), words.number("remission mode");
  const std::size_t count = words.count("number of readings");
  set_beams(scan, start, resolution, readings(words, count, limit), words.file);
  const std::size_t remissions = words.count("number of remissions");
  for (std::size_t i = 0; i < remissions; ++i) words.number("remission");
  if (robot) {
    words.pose("laser pose");
    scan.odometry = words.pose("robot pose");
    for (int i = 0; i < 5; ++i) words.number("speeds and safety distances");
  }
  scan.stamp_s = words.number("time");
}

/// How a message ends. What is not whole stands at the end of a file that was cut off, and is left out.
enum class Ending {
  whole,
  torn,     ///< its words end too soon, or in the middle of one
  doubtful  ///< behind its last word, the time, there is nothing, not even the line's end: digits may lack
};

/// A message into the scan. `first`: no scan stands before it; it is then whole, or an error. `whole` is how many words stood
/// behind the time in the message of that name before it, where there was one. A word that is no number is torn only where
/// the line has no end.
Ending read_message(Words& words, const Lines& lines, bool first, std::optional<std::size_t>& whole,
                    Scan& scan) {
  const std::string_view name = words.fields[0];
  try {
    if (name == "FLASER") {
      read_flaser(words, scan);
    } else {
      read_newer(words, name.starts_with("ROBOTLASER"), scan);
    }
  } catch (const InputError&) {
    const bool cut = words.ran_out || !lines.had_end();
    if (!first && lines.was_last() && words.used_up() && cut) return Ending::torn;
    throw;
  }
  if (whole && words.left() < *whole && !lines.had_end()) return Ending::torn;
  if (!first && words.used_up() && !lines.had_end()) return Ending::doubtful;
  whole = words.left();
  return Ending::whole;
}

/// The latter two and a number.
constexpr std::string_view message_names[] = {"FLASER", "ROBOTLASER", "RAWLASER"};

bool is_message(std::string_view name) {
  return name == message_names[0] || name.starts_with(message_names[1]) || name.starts_with(message_names[2]);
}

/// True for a line that ends within the name of a message.
bool torn_in_its_name(const std::vector<std::string_view>& fields, const Lines& lines) {
  if (lines.had_end() || fields.size() != 1) return false;
  for (const std::string_view name : message_names)
    if (name.starts_with(fields[0])) return true;
  return false;
}

}  // namespace

ScanLog read_carmen_log(const std::string& path, const std::string& text) {
  ScanLog log{path, "CARMEN log", {}, 0};
  Lines lines(text, path);
  std::map<std::string, std::optional<std::size_t>> behind_time;  // words there, by message
  for (std::string_view line; lines.next(line);) {
    const auto fields = word_fields(line);
    if (fields.empty() || fields[0].front() == '#') continue;
    const bool first = log.scans.empty(), message = is_message(fields[0]);
    if (!message && (first || !torn_in_its_name(fields, lines))) {
      ++log.lines_skipped;
      continue;
    }
    Scan scan;
    scan.row = lines.number();
    Words words{fields, path, scan.row};
    const Ending ending =
        message ? read_message(words, lines, first, behind_time[std::string(fields[0])], scan) : Ending::torn;
    if (ending == Ending::whole) {
      log.scans.push_back(std::move(scan));
      continue;
    }
    log.warning = last_line_left_out(
        path, lines.number(),
        ending == Ending::torn ? torn_line : "has no end, so that its time may be cut short");
  }
  return log;
}

}  // namespace rangecal::io
