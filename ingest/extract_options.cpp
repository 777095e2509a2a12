// SPDX-License-Identifier: BSD-3-Clause
#include "extract_options.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <filesystem>
#include <iterator>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/solvers/extract/extract.hpp"
#include "scan_files.hpp"

namespace rangecal::ingest {
namespace {

/// The options as the command line gives them.
struct Given {
  std::vector<std::string> scans;
  std::string stops, map, radius = "free", arc = "nearest", split = "automatic";
  std::string error = "independent", sensor, principle;
  std::vector<double> noise;
  double range_min = 0.0, range_max = std::numeric_limits<double>::infinity();
  double bearing_offset = 0.0;
  BagChoice bag;
  ExtractOptions options;
};

double positive(const std::string& text, const char* option) {
  double value = 0.0;
  const auto [end, code] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (code != std::errc() || end != text.data() + text.size() || !(value > 0.0) || !std::isfinite(value))
    throw InputError(fmt::format("{}: '{}' is not a positive number", option, text));
  return value;
}

std::vector<double> radii_from(const std::string& text) {
  std::vector<double> radii;
  if (text == "free") return radii;
  for (std::size_t at = 0; at <= text.size();) {
    const std::size_t comma = std::min(text.find(',', at), text.size());
    radii.push_back(positive(text.substr(at, comma - at), "--radius"));
    if (radii.back() > 2.0)
      throw InputError(fmt::format("--radius: {} m is no landmark's; it is given in metres", radii.back()));
    at = comma + 1;
  }
  return radii;
}

std::vector<MappedLandmark> map_from(const std::string& path) {
  const CsvTable table = CsvTable::read(path);
  const std::size_t label = table.require("landmark"), x = table.require("x_m"), y = table.require("y_m");
  const auto radius = table.optional("radius_m");
  std::vector<MappedLandmark> map;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    MappedLandmark landmark{
        table.label(row, label), {table.finite(row, x), table.finite(row, y)}, std::nullopt};
    if (radius && table.number(row, *radius)) landmark.radius_m = table.finite(row, *radius);
    for (const MappedLandmark& other : map)
      if (other.label == landmark.label)
        table.fail(row, label, "landmark '" + landmark.label + "' is listed twice");
    map.push_back(landmark);
  }
  if (map.empty()) throw InputError(path, 0, "", "holds a header and no rows");
  return map;
}

ExtractOptions options_from(const Given& given) {
  ExtractOptions options = given.options;
  options.arc = arc_rule_from_string(given.arc);
  options.split = stop_split_from_string(given.split);
  CylinderOptions& cylinder = options.cylinder;
  cylinder.radii_m = radii_from(given.radius);
  cylinder.range_min_m = given.range_min, cylinder.range_max_m = given.range_max;
  if (!(given.range_min >= 0.0) || !(given.range_max > given.range_min))
    throw InputError("--range-max must be above --range-min, and that not negative");
  if (cylinder.beams_min < 2) throw InputError("--beams-min must be at least 2");
  if (options.stand.scans_min < 1) throw InputError("--scans-min must be at least 1");
  if (!(cylinder.edge_cut > 0.3) || cylinder.edge_cut > 1.0)
    throw InputError("--edge-cut must lie between 0.3 and 1");
  if (!(options.support >= 0.0) || options.support > 1.0) throw InputError("--support is a share, 0 to 1");
  if (!given.noise.empty()) {
    if (given.noise.size() != 2 || !(given.noise[0] > 0.0) || !(given.noise[1] >= 0.0))
      throw InputError(
          "--noise takes FLOOR,QUADRATIC: a positive length [m] and a number of at least 0 [1/m]");
    options.noise = ScanNoise{given.noise[0], given.noise[1]};
  }
  if (given.error != "independent" && given.error != "random_walk")
    throw InputError("--error: '" + given.error + "' is neither independent nor random_walk");
  AssociationOptions& association = options.association;
  association.error =
      given.error == "random_walk" ? StopErrorModel::random_walk : StopErrorModel::independent;
  association.bearing_offset_rad = given.bearing_offset;
  if (!(std::abs(given.bearing_offset) <= 2.0 * std::numbers::pi))
    throw InputError(
        fmt::format("--bearing-offset: {} is beyond +-2 pi rad: degrees, most likely; convert to radians",
                    given.bearing_offset));
  if (!(association.sigma_xy_m >= 0.0) || !(association.sigma_heading_rad >= 0.0))
    throw InputError("--sigma-xy and --sigma-heading must not be negative");
  if (!given.map.empty()) options.map = map_from(given.map);
  return options;
}

std::string source_of(const std::vector<ScanSource*>& sources) {
  const std::string first = std::filesystem::path(sources.front()->log().path).filename().string();
  return sources.size() == 1 ? first : fmt::format("{} and {} more", first, sources.size() - 1);
}

/// A question about the unit of the ranges, where no room is as large as they say; else empty.
std::string unit_warning(const Extraction& extraction) {
  constexpr double largest_m = 100.0;
  return extraction.median_return_m > largest_m
             ? fmt::format("half of the ranges are above {:.0f} m: are they in metres?",
                           extraction.median_return_m)
             : std::string();
}

Extracted extract(const Given& given, const ReadProgress& progress) {
  static constexpr std::string_view again = " again";  // long bags are read several times
  Extracted out;
  require_distinct(files_behind(given.scans));
  if (!given.bag.frames.empty() && given.bag.odometry.empty())
    throw InputError("--frames says which transforms of the topic that --odom names; name one");
  out.options = options_from(given);
  std::vector<Stop> stops;
  if (!given.stops.empty())
    stops = stops_of(CsvTable::read(given.stops), out.options.association.sigma_heading_rad);
  std::vector<std::unique_ptr<ScanSource>> files;
  std::vector<ScanSource*> sources;
  for (const std::string& path : given.scans) {
    BagChoice choice = given.bag;
    if (progress)
      choice.progress = [&progress, name = path](double share) mutable {
        progress(name, share);
        if (share >= 1.0 && !name.ends_with(again)) name += again;
      };
    files.push_back(open_scan_file(path, choice, 1'000'000 / given.scans.size()));
    sources.push_back(files.back().get());
  }
  out.extraction = extract_recording(sources, stops, out.options);
  for (const ScanSource* source : sources)
    if (!source->log().warning.empty()) out.warnings.push_back(source->log().warning);
  if (out.extraction.recording.landmarks.empty())
    if (std::string warning = unit_warning(out.extraction); !warning.empty())
      out.warnings.push_back(std::move(warning));
  out.extraction.recording.sensor.name = given.sensor,
  out.extraction.recording.sensor.principle = given.principle;
  out.source = source_of(sources), out.format = sources.front()->log().format;
  note_extraction(out.extraction, out.options, out.source);
  return out;
}

}  // namespace

std::function<Extracted()> add_extract_options(CLI::App& command, const ReadProgress& progress) {
  const auto given = std::make_shared<Given>();
  command
      .add_option(
          "SCANS", given->scans,
          "files of scans: CSV (stamp, angle_min, angle_increment, ranges... or stamp, angle_rad, range_m), CARMEN "
          "logs, bags of ROS 1 and ROS 2 (MCAP, SQLite, rosbag2 folders); -: stdin")
      ->required();

  command
      .add_option("--radius", given->radius,
                  "radius of the cylinders [m]; several kinds as 0.04,0.12; 'free': estimated, 2 to 20 cm")
      ->capture_default_str()
      ->group("Landmarks");
  command
      .add_option("--map", given->map,
                  "CSV with landmark, x_m, y_m and perhaps radius_m: known places, for the labels")
      ->group("Landmarks");
  command
      .add_option("--arc", given->arc,
                  "which point of the arc is the range: nearest (of the fitted circle), mean, smallest")
      ->capture_default_str()
      ->group("Landmarks");
  command.add_option("--beams-min", given->options.cylinder.beams_min, "hits that a cylinder must have")
      ->capture_default_str()
      ->group("Landmarks");
  command
      .add_option("--edge-cut", given->options.cylinder.edge_cut,
                  "hits that pass the axis at more than this share of the radius are dropped: mixed pixels")
      ->capture_default_str()
      ->group("Landmarks");
  command
      .add_option("--support", given->options.support,
                  "share of a stop's scans in which a landmark must be found")
      ->capture_default_str()
      ->group("Landmarks");

  command
      .add_option(
          "--stops", given->stops,
          "stops.csv: stop, x_m, y_m, heading_rad (else odometry of the log, or one stop at the origin)")
      ->group("Stops");
  command
      .add_option(
          "--split", given->split,
          "what tells stops apart: label (column 'stop'), file, scan, standing (the robot stands), automatic")
      ->capture_default_str()
      ->group("Stops");
  command
      .add_option("--scans-min", given->options.stand.scans_min,
                  "scans that a stand must have; fewer: moving")
      ->capture_default_str()
      ->group("Stops");
  command
      .add_option("--sigma-xy", given->options.association.sigma_xy_m,
                  "how far a stop may be from its pose [m]")
      ->capture_default_str()
      ->group("Stops");
  command
      .add_option("--sigma-heading", given->options.association.sigma_heading_rad,
                  "the same for its heading [rad]")
      ->capture_default_str()
      ->group("Stops");
  command
      .add_option("--error", given->error,
                  "independent, or random_walk: the error accumulates from stop to stop")
      ->capture_default_str()
      ->group("Stops");

  command
      .add_option(
          "--noise", given->noise,
          "FLOOR,QUADRATIC [m, 1/m]: sd of a beam sqrt(FLOOR^2 + (QUADRATIC r^2)^2); estimated if not given")
      ->delimiter(',')
      ->group("Sensor");
  command.add_option("--range-min", given->range_min, "readings below are no hits [m]")
      ->capture_default_str()
      ->group("Sensor");
  command.add_option("--range-max", given->range_max, "readings above are no hits [m]")->group("Sensor");
  command.add_flag("--clockwise", given->options.clockwise, "bearings of the scans run clockwise")
      ->group("Sensor");
  command
      .add_option("--bearing-offset", given->bearing_offset,
                  "mount of the sensor [rad], for the labels alone; the recording keeps raw bearings")
      ->capture_default_str()
      ->group("Sensor");
  command.add_option("--sensor", given->sensor, "name of the sensor, for the recording")->group("Sensor");
  command.add_option("--principle", given->principle, "triangulation, phase, ..., for the recording")
      ->group("Sensor");
  command
      .add_option("--scan,--topic", given->bag.scan,
                  "topic of the scans (sensor_msgs/LaserScan), where the bag has several")
      ->group("Bags");
  command
      .add_option(
          "--odom", given->bag.odometry,
          "topic of the robot's odometry: poses of the stops, and where it stands (nav_msgs/Odometry, "
          "geometry_msgs/PoseStamped, tf2_msgs/TFMessage)")
      ->group("Bags");
  command
      .add_option("--frames", given->bag.frames,
                  "PARENT,CHILD: the transform that is the odometry, where --odom names a topic of several")
      ->group("Bags");
  return [given, progress] { return extract(*given, progress); };
}

std::vector<std::string> extract_inputs(const CLI::App& command) {
  std::vector<std::string> files = files_behind(command.get_option("SCANS")->results());
  for (const char* option : {"--stops", "--map"})
    for (const std::string& file : command.get_option(option)->results()) files.push_back(file);
  return files;
}

}  // namespace rangecal::ingest
