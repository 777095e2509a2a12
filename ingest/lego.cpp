// SPDX-License-Identifier: BSD-3-Clause
// LEGO robot among six cylinders (C. Brenner, SLAM Lectures 2012), as published:
//   robot4_scan.txt            S t count r0 .. r659       t [ms], ranges [mm]
//   robot4_motors.txt          M t left .. .. .. right    words 3 and 7: tick counters
//   robot4_reference.txt       P t x y                    overhead camera [mm], no heading
//   robot_arena_landmarks.txt  L C x y radius             surveyed [mm]
// Records are paired by their number, as the course does. Beam i points to (i - 330) 2 pi / 1024; the scanner is
// mounted at -4 degrees, which is used for the labels and left in the bearings. Each scan is a stop: the robot drives.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "extraction_text.hpp"
#include "importer.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

constexpr double kPitch = 2.0 * std::numbers::pi / 1024.0;  ///< from beam to beam [rad]
constexpr double kMount = -0.06981317007977318;  ///< of the scanner on the robot [rad], stated by the course
constexpr double kTick = 0.349e-3;               ///< way of one tick [m]
/// Of poses from the camera: how far it is from the scanner and off in time [m], and how far a heading from its track is off
/// [rad], both as the surveyed cylinders show it in this recording; records before and after that make a heading.
constexpr double kCameraM = 0.05, kTrackRad = 0.15;
constexpr std::size_t kTrackRecords = 20;
constexpr Pose2 kStart{1.850, 1.897, 213.0 * std::numbers::pi / 180.0};

struct Given {
  std::string source, arc = "nearest", poses = "odometry";
  double track_m = 0.150;
  std::optional<double> radius_m;
};

ScanLog read_scans_of(const std::string& path) {
  const WordTable table(path);
  ScanLog log{path, "LEGO robot", {}, 0};
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Scan scan;
    scan.row = static_cast<int>(row) + 1;
    scan.stamp_s = 1e-3 * table.number(row, 1);
    const double count = table.number(row, 2);
    if (count != static_cast<double>(table.words(row) - 3))
      throw InputError(path, scan.row, "",
                       fmt::format("says {} beams, the line holds {}", count, table.words(row) - 3));
    for (std::size_t i = 0; i + 3 < table.words(row); ++i) {
      scan.bearing_rad.push_back((static_cast<double>(i) - 330.0) * kPitch);
      scan.range_m.push_back(1e-3 * table.number(row, i + 3));
    }
    log.scans.push_back(std::move(scan));
  }
  return log;
}

/// Wheel odometry of two tracks: a = (right - left) / track, c = (right + left) / 2, along the chord.
std::vector<Pose2> odometry(const std::string& path, double track_m) {
  const WordTable table(path);
  std::vector<Pose2> poses{kStart};
  poses[0].heading_rad = wrap_angle(kStart.heading_rad);
  for (std::size_t row = 1; row < table.rows(); ++row) {
    const double left = kTick * (table.number(row, 2) - table.number(row - 1, 2));
    const double right = kTick * (table.number(row, 6) - table.number(row - 1, 6));
    const double turn = (right - left) / track_m, way = 0.5 * (left + right);
    Pose2 pose = poses.back();
    pose.x_m += way * std::cos(pose.heading_rad + 0.5 * turn);
    pose.y_m += way * std::sin(pose.heading_rad + 0.5 * turn);
    pose.heading_rad = wrap_angle(pose.heading_rad + turn);
    poses.push_back(pose);
  }
  return poses;
}

/// The turn that takes places into others, as a whole and shifted at will: least squares [rad].
///   atan2(sum a x b, sum a . b),   a, b from their means
double turn_between(std::span<const Pose2> from, std::span<const Pose2> to) {
  Eigen::Vector2d mean_from(0.0, 0.0), mean_to(0.0, 0.0);
  const auto n = static_cast<double>(from.size());
  for (std::size_t i = 0; i < from.size(); ++i)
    mean_from += Eigen::Vector2d(from[i].x_m, from[i].y_m) / n,
        mean_to += Eigen::Vector2d(to[i].x_m, to[i].y_m) / n;
  double sine = 0.0, cosine = 0.0;
  for (std::size_t i = 0; i < from.size(); ++i) {
    const Eigen::Vector2d a = Eigen::Vector2d(from[i].x_m, from[i].y_m) - mean_from,
                          b = Eigen::Vector2d(to[i].x_m, to[i].y_m) - mean_to;
    sine += a.x() * b.y() - a.y() * b.x(), cosine += a.dot(b);
  }
  return std::atan2(sine, cosine);
}

/// Places of the camera; headings of the odometry, turned as its way around each record lies in the camera's track.
std::vector<Pose2> placed_by_camera(const std::string& path, const std::vector<Pose2>& odometry) {
  const WordTable table(path);
  std::vector<Pose2> poses;
  for (std::size_t row = 0; row < std::min(table.rows(), odometry.size()); ++row)
    poses.push_back({1e-3 * table.number(row, 2), 1e-3 * table.number(row, 3), odometry[row].heading_rad});
  for (std::size_t k = 0; k < poses.size(); ++k) {
    const std::size_t begin = k - std::min(k, kTrackRecords),
                      count = std::min(poses.size(), k + kTrackRecords + 1) - begin;
    const double turn = turn_between(std::span(odometry).subspan(begin, count),
                                     std::span<const Pose2>(poses).subspan(begin, count));
    poses[k].heading_rad = wrap_angle(poses[k].heading_rad + turn);
  }
  return poses;
}

/// How far the stops may be off: each from the camera's place, or step by step along the wheels' way.
void state_errors(const Given& given, AssociationOptions& association) {
  if (given.poses == "reference") {
    association.error = StopErrorModel::independent;
    association.sigma_xy_m = kCameraM, association.sigma_heading_rad = kTrackRad;
  } else {
    association.error = StopErrorModel::random_walk;
    association.sigma_xy_m = 0.01, association.sigma_heading_rad = 0.03;
  }
}

/// A warning where the poses do not let most cylinders be named; else empty.
std::string naming_warning(const Extraction& extraction) {
  const auto count = [&](const char* fate) {
    const auto found = extraction.cylinders.find(fate);
    return found == extraction.cylinders.end() ? 0L : found->second;
  };
  const long all = count("found"), unmatched = count("matches no landmark") + count("ambiguous");
  if (2 * unmatched <= all) return {};
  return fmt::format(
      "{} of {} cylinders match no surveyed landmark: the poses do not fit the scans (--poses, --track)",
      unmatched, all);
}

std::vector<MappedLandmark> surveyed(const std::string& path) {
  const WordTable table(path);
  std::vector<MappedLandmark> map;
  for (std::size_t row = 0; row < table.rows(); ++row)
    map.push_back({fmt::format("C{}", row),
                   {1e-3 * table.number(row, 2), 1e-3 * table.number(row, 3)},
                   1e-3 * table.number(row, 4)});
  return map;
}

Imported import_lego(const Given& given) {
  if (given.poses != "odometry" && given.poses != "reference")
    throw InputError("--poses: '" + given.poses + "' is neither odometry nor reference");
  if (given.radius_m && !(*given.radius_m >= 0.0 && *given.radius_m <= 0.1))
    throw InputError("--radius must lie between 0 and 0.1 m");
  if (!(given.track_m > 0.0)) throw InputError("--track must be positive");
  const std::string scans = given.source + "/robot4_scan.txt", motors = given.source + "/robot4_motors.txt",
                    camera = given.source + "/robot4_reference.txt",
                    survey = given.source + "/robot_arena_landmarks.txt";
  const ScanLog log = read_scans_of(scans);
  std::vector<Pose2> poses = odometry(motors, given.track_m);
  if (given.poses == "reference") poses = placed_by_camera(camera, poses);
  if (poses.size() < log.scans.size())
    throw InputError(given.source, 0, "",
                     fmt::format("{} scans and {} poses", log.scans.size(), poses.size()));
  std::vector<Stop> stops;
  for (std::size_t k = 0; k < log.scans.size(); ++k) {
    Stop stop;
    stop.label = std::to_string(k), stop.commanded = poses[k];
    stops.push_back(stop);
  }
  ExtractOptions options;
  options.map = surveyed(survey);
  options.arc = arc_rule_from_string(given.arc);
  options.split = StopSplit::scan;
  options.cylinder.radii_m = {*options.map.front().radius_m};
  // On the white cylinders this scanner's ranges wander by centimetres, strongest in the middle of the arc, which looks
  // flat or hollow: its shape says little, what stands alone and has a cylinder's width is one.
  options.noise = ScanNoise{0.012, 0.0};
  options.cylinder.shape_tolerance = 0.4;
  options.cylinder.flat_nats = std::numeric_limits<double>::infinity();
  options.cylinder.range_slack_m = options.association.range_slack_m =
      0.05;  // and it reads some centimetres too far
  options.cylinder.range_min_m = 0.02, options.cylinder.range_max_m = 2.5;
  state_errors(given, options.association);
  options.association.bearing_offset_rad = kMount;
  Extraction extraction = extract_recording(std::vector{log}, stops, options);
  Recording& recording = extraction.recording;
  recording.sensor.name = "lego-scanner", recording.sensor.principle = "phase";
  if (given.radius_m)
    for (Landmark& landmark : recording.landmarks) landmark.radius_m = *given.radius_m;
  for (const Landmark& landmark : recording.landmarks)
    for (const MappedLandmark& known : options.map)
      if (known.label == landmark.label) recording.truth.landmarks.emplace_back(known.position);
  note_extraction(extraction, options, "LEGO robot, C. Brenner 2012, poses by " + given.poses);
  Imported out{recording,
               describe(extraction, options) + "\n",
               extraction_json(extraction, options),
               {scans, motors, camera, survey},
               {}};
  if (std::string warning = naming_warning(extraction); !warning.empty())
    out.warnings.push_back(std::move(warning));
  return out;
}

std::function<Imported()> add(CLI::App& command) {
  const auto given = std::make_shared<Given>();
  command.add_option("DIR", given->source, "folder with robot4_scan.txt, robot4_motors.txt, ...")->required();
  command
      .add_option(
          "--poses", given->poses,
          "odometry: start and wheel ticks, errors that add up; reference: places of the overhead camera, headings "
          "of the odometry turned along its track, errors of each stop its own")
      ->capture_default_str();
  command
      .add_option("--track", given->track_m,
                  "distance of the tracks [m]; the course uses 0.150, 0.155 and 0.173")
      ->capture_default_str();
  command.add_option(
      "--radius", given->radius_m,
      "radius written into the recording [m], else the surveyed one; 0 counts distances to the axis, as "
      "the course does");
  command.add_option("--arc", given->arc, "which point of the arc is the range: nearest, mean, smallest")
      ->capture_default_str();
  command.footer(
      "Data: the 'SLAM Lectures' of Claus Brenner, unit A (public copies on GitHub: dudeperf3ct/Slam-Lectures).\n"
      "Cylinders are cut out of the raw scans as 'rangecal extract' does, labelled by the surveyed map.\n"
      "Example:\n"
      "  rangecal import lego brenner-lego -o rec && rangecal diagnose rec");
  return [given] { return import_lego(*given); };
}

const bool kKnown =
    know_importer({"lego", "LEGO robot among six cylinders (C. Brenner 2012): raw scans", add});

}  // namespace
}  // namespace rangecal::ingest
