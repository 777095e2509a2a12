// SPDX-License-Identifier: BSD-3-Clause
// UTIAS multi-robot data set (Leung, Halpern, Barfoot, Liu, IJRR 30(8), 2011), as published; # begins a comment:
//   Barcodes.dat               subject, barcode                     subjects 1-5 robots, 6-20 tubes
//   Landmark_Groundtruth.dat   subject, x, y [m], their sds
//   RobotN_Measurement.dat     time [s], barcode, range [m], bearing [rad]
//   RobotN_Groundtruth.dat     time, x, y, heading                  motion capture, 100 Hz with gaps
//   RobotN_Odometry.dat        time, speed [m/s], turn rate [rad/s] commands
// A sighting of a tube is used where the motion capture poses around it are no more than 0.25 s apart; times count from
// the whole second of the first measurement.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>
#include <optional>
#include <set>

#include "importer.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::ingest {
namespace {

constexpr double kGap =
    0.25;  ///< between the motion capture poses around a sighting; half-width for speeds [s]
constexpr double kForever = 1e9;  ///< commands hold until the next [s]
constexpr double kStandM = 0.02,
                 kStandRad = 0.02;  ///< a dwell ends where the robot is farther than this from its start

struct Given {
  std::string source, as = "stops", poses = "mocap";
  int robot = 0, readings_min = 4, tubes_min = 2, stops_max = 0;
};

/// Poses over time, linear between them.
struct Track {
  std::vector<double> time_s;
  std::vector<Pose2> pose;

  /// The pose at a time between two that are no farther than `gap` apart.
  std::optional<Pose2> at(double time, double gap) const {
    const auto after = std::upper_bound(time_s.begin(), time_s.end(), time);
    if (after == time_s.begin() || after == time_s.end()) return std::nullopt;
    const auto j = static_cast<std::size_t>(after - time_s.begin()), i = j - 1;
    if (time_s[j] - time_s[i] > gap) return std::nullopt;
    const double share = (time - time_s[i]) / (time_s[j] - time_s[i]);
    const Pose2 &a = pose[i], &b = pose[j];
    return Pose2{a.x_m + share * (b.x_m - a.x_m), a.y_m + share * (b.y_m - a.y_m),
                 wrap_angle(a.heading_rad + share * wrap_angle(b.heading_rad - a.heading_rad))};
  }
};

struct Sighted {
  double time_s = 0.0, range_m = 0.0, bearing_rad = 0.0;
  int tube = 0;
  Pose2 pose;
  double speed_mps = 0.0, turn_radps = 0.0;
};

struct DataSet {
  std::map<int, Eigen::Vector2d> tubes;
  std::vector<Sighted> sightings;
  double zero_s = 0.0;
  int robots_seen = 0, unknown = 0, without_pose = 0;
};

Track motion_capture(const std::string& path) {
  const WordTable table(path);
  Track track;
  for (std::size_t row = 0; row < table.rows(); ++row) {
    track.time_s.push_back(table.number(row, 0));
    track.pose.push_back({table.number(row, 1), table.number(row, 2), table.number(row, 3)});
  }
  return track;
}

/// Dead reckoning of the commanded speeds, each held until the next, from a pose.
Track dead_reckoning(const std::string& path, double from_s, const Pose2& start) {
  const WordTable table(path);
  Track track;
  Pose2 pose = start;
  double time = from_s, speed = 0.0, rate = 0.0;
  const auto drive_to = [&](double to) {
    const double turn = rate * (to - time), way = speed * (to - time);
    pose.x_m += way * std::cos(pose.heading_rad + 0.5 * turn),
        pose.y_m += way * std::sin(pose.heading_rad + 0.5 * turn);
    pose.heading_rad = wrap_angle(pose.heading_rad + turn), time = to;
  };
  for (std::size_t row = 0; row < table.rows(); ++row) {
    const double at = table.number(row, 0);
    if (at > time) {
      track.time_s.push_back(time), track.pose.push_back(pose);
      drive_to(at);
    }
    speed = table.number(row, 1), rate = table.number(row, 2);
  }
  track.time_s.push_back(time), track.pose.push_back(pose);
  return track;
}

/// Speed along the track and turn rate over +-0.25 s around a time; 0 where motion capture ends there.
void add_speeds(const Track& truth, Sighted& sighting) {
  const double t = sighting.time_s;
  const auto before = truth.at(t - kGap, kForever), after = truth.at(t + kGap, kForever);
  if (!before || !after) return;
  sighting.speed_mps = std::hypot(after->x_m - before->x_m, after->y_m - before->y_m) / (2.0 * kGap);
  sighting.turn_radps = wrap_angle(after->heading_rad - before->heading_rad) / (2.0 * kGap);
}

DataSet read_data_set(const Given& given) {
  const std::string robot = given.source + "/Robot" + std::to_string(given.robot) + "_";
  DataSet data;
  std::map<int, int> subject_of;
  const WordTable codes(given.source + "/Barcodes.dat");
  for (std::size_t row = 0; row < codes.rows(); ++row) subject_of[codes.whole(row, 1)] = codes.whole(row, 0);
  const WordTable places(given.source + "/Landmark_Groundtruth.dat");
  for (std::size_t row = 0; row < places.rows(); ++row)
    data.tubes[places.whole(row, 0)] = {places.number(row, 1), places.number(row, 2)};
  const Track truth = motion_capture(robot + "Groundtruth.dat");
  const WordTable table(robot + "Measurement.dat");
  data.zero_s = std::floor(table.number(0, 0));
  for (std::size_t row = 0; row < table.rows(); ++row) {
    Sighted sighting{table.number(row, 0), table.number(row, 2), table.number(row, 3), 0, {}, 0.0, 0.0};
    const auto subject = subject_of.find(table.whole(row, 1));
    if (subject == subject_of.end()) {
      ++data.unknown;
      continue;
    }
    sighting.tube = subject->second;
    if (data.tubes.find(sighting.tube) == data.tubes.end()) {
      ++data.robots_seen;
      continue;
    }
    const auto pose = truth.at(sighting.time_s, kGap);
    if (!pose) {
      ++data.without_pose;
      continue;
    }
    sighting.pose = *pose;
    add_speeds(truth, sighting);
    data.sightings.push_back(sighting);
  }
  if (data.sightings.empty())
    throw InputError(table.path(), 0, "", "holds no sighting of a tube with motion capture");
  return data;
}

int landmark_index(Recording& recording, const DataSet& data, int tube) {
  const std::string label = "T" + std::to_string(tube);
  for (std::size_t j = 0; j < recording.landmarks.size(); ++j)
    if (recording.landmarks[j].label == label) return static_cast<int>(j);
  recording.landmarks.push_back({label, 0.0, std::nullopt});
  recording.truth.landmarks.emplace_back(data.tubes.at(tube));
  return static_cast<int>(recording.landmarks.size()) - 1;
}

Recording as_pairs(const DataSet& data) {
  Recording recording;
  recording.kind = RecordingKind::pairs;
  Pairs& pairs = recording.pairs;
  for (const Sighted& sighting : data.sightings) {
    pairs.true_m.push_back(
        (data.tubes.at(sighting.tube) - Eigen::Vector2d(sighting.pose.x_m, sighting.pose.y_m)).norm());
    pairs.reading_m.push_back(sighting.range_m),
        pairs.bearing_rad.push_back(wrap_angle(sighting.bearing_rad));
    pairs.landmark.push_back(landmark_index(recording, data, sighting.tube));
    pairs.time_s.push_back(sighting.time_s - data.zero_s);
    pairs.covariates["speed_mps"].push_back(sighting.speed_mps);
    pairs.covariates["turn_rate_radps"].push_back(sighting.turn_radps);
    pairs.row.push_back(static_cast<int>(pairs.size()) + 1);
  }
  return recording;
}

/// Consecutive sightings during which the true pose stays near the first one's.
std::vector<std::vector<Sighted>> dwells(const DataSet& data) {
  std::vector<std::vector<Sighted>> out;
  for (const Sighted& sighting : data.sightings) {
    bool stays = !out.empty();
    if (stays) {
      const Pose2 &a = out.back().front().pose, &b = sighting.pose;
      stays = std::hypot(a.x_m - b.x_m, a.y_m - b.y_m) <= kStandM &&
              std::abs(wrap_angle(a.heading_rad - b.heading_rad)) <= kStandRad;
    }
    if (!stays) out.emplace_back();
    out.back().push_back(sighting);
  }
  return out;
}

Pose2 mean_pose(const std::vector<Sighted>& dwell) {
  double x = 0.0, y = 0.0, c = 0.0, s = 0.0;
  for (const Sighted& sighting : dwell) {
    x += sighting.pose.x_m, y += sighting.pose.y_m;
    c += std::cos(sighting.pose.heading_rad), s += std::sin(sighting.pose.heading_rad);
  }
  const auto n = static_cast<double>(dwell.size());
  return {x / n, y / n, std::atan2(s, c)};
}

Recording as_stops(const DataSet& data, const Given& given) {
  Recording recording;
  const bool odometry = given.poses == "odometry";
  recording.sigma_xy_m = odometry ? 0.02 : 0.01, recording.sigma_heading_rad = odometry ? 0.03 : 0.01;
  recording.stop_error = odometry ? StopErrorModel::random_walk : StopErrorModel::independent;
  std::optional<Track> reckoned;
  Readings& readings = recording.readings;
  for (const auto& dwell : dwells(data)) {
    std::set<int> tubes;
    for (const Sighted& sighting : dwell) tubes.insert(sighting.tube);
    if (static_cast<int>(tubes.size()) < given.tubes_min ||
        static_cast<int>(dwell.size()) < given.readings_min)
      continue;
    if (given.stops_max > 0 && static_cast<int>(recording.stops.size()) == given.stops_max) break;
    Stop stop;
    stop.label = std::to_string(recording.stops.size());
    const Pose2 truth = mean_pose(dwell);
    stop.commanded = truth;
    if (odometry) {  // motion capture gives the first pose, which is where the frame is; the rest is reckoned
      const double middle = 0.5 * (dwell.front().time_s + dwell.back().time_s);
      if (!reckoned) {
        const std::string file = given.source + "/Robot" + std::to_string(given.robot) + "_Odometry.dat";
        reckoned = dead_reckoning(file, middle, truth);
      }
      stop.commanded = reckoned->at(middle, kForever).value_or(reckoned->pose.back());
    }
    const auto k = static_cast<int>(recording.stops.size());
    recording.stops.push_back(stop);
    if (odometry) recording.truth.stops.emplace_back(truth);
    std::map<int, int> repeat;
    for (const Sighted& sighting : dwell) {
      readings.stop.push_back(k), readings.landmark.push_back(landmark_index(recording, data, sighting.tube));
      readings.repeat.push_back(repeat[sighting.tube]++);
      readings.time_s.push_back(sighting.time_s - data.zero_s);
      readings.range_m.push_back(sighting.range_m),
          readings.bearing_rad.push_back(wrap_angle(sighting.bearing_rad));
      readings.row.push_back(static_cast<int>(readings.size()) + 1);
    }
  }
  if (recording.stops.empty())
    throw InputError(given.source, 0, "", "the robot never stands long enough for a stop");
  return recording;
}

/// Throws InputError for an option out of its range, or one that would be ignored.
void check(const Given& given) {
  if (given.as != "stops" && given.as != "pairs")
    throw InputError("--as: '" + given.as + "' is neither stops nor pairs");
  if (given.poses != "mocap" && given.poses != "odometry")
    throw InputError("--poses: '" + given.poses + "' is neither mocap nor odometry");
  if (given.readings_min < 1) throw InputError("--readings-min must be at least 1");
  if (given.tubes_min < 1) throw InputError("--tubes-min must be at least 1");
  if (given.stops_max < 0) throw InputError("--stops-max must not be negative");
  if (given.as != "pairs") return;
  const Given plain;
  if (given.poses != plain.poses)
    throw InputError("--poses is of stops: the true distances of --as pairs are those of motion capture");
  if (given.readings_min != plain.readings_min || given.tubes_min != plain.tubes_min ||
      given.stops_max != plain.stops_max)
    throw InputError("--readings-min, --tubes-min and --stops-max are of stops: --as pairs has none");
}

Imported import_mrclam(const Given& given) {
  check(given);
  const DataSet data = read_data_set(given);
  Recording recording = given.as == "pairs" ? as_pairs(data) : as_stops(data, given);
  recording.sensor = {"barcode-camera", "camera", 0.3, 12.0};
  std::string words = fmt::format(
      "sightings  {} of tubes between motion capture poses {} s apart at most; {} of other robots, {} of unknown "
      "barcodes, {} without "
      "motion capture left out\n",
      data.sightings.size(), kGap, data.robots_seen, data.unknown, data.without_pose);
  if (given.as == "stops")
    words += fmt::format(
        "stops      {} dwells within {} m and {} rad with {} readings of {} tubes at least; {} sightings outside "
        "them\n",
        recording.stops.size(), kStandM, kStandRad, given.readings_min, given.tubes_min,
        data.sightings.size() - recording.readings.size());
  const std::string robot = given.source + "/Robot" + std::to_string(given.robot) + "_";
  return {recording,
          words,
          "",
          {given.source + "/Barcodes.dat", given.source + "/Landmark_Groundtruth.dat",
           robot + "Measurement.dat", robot + "Groundtruth.dat", robot + "Odometry.dat"},
          {}};
}

std::function<Imported()> add(CLI::App& command) {
  const auto given = std::make_shared<Given>();
  command.add_option("DIR", given->source, "folder with Barcodes.dat, RobotN_Measurement.dat, ...")
      ->required();
  command.add_option("--robot", given->robot, "number of the robot, 1 to 5")
      ->required()
      ->check(CLI::Range(1, 5));
  command
      .add_option("--as", given->as,
                  "stops: sightings grouped where the robot stands, tubes unknown; pairs: true distance "
                  "and reading")
      ->capture_default_str();
  command
      .add_option("--poses", given->poses,
                  "of the stops: mocap, or odometry (reckoned from the first stop's true pose)")
      ->capture_default_str();
  command.add_option("--readings-min", given->readings_min, "readings that a stop must have")
      ->capture_default_str();
  command.add_option("--tubes-min", given->tubes_min, "tubes that a stop must see")->capture_default_str();
  command.add_option("--stops-max", given->stops_max, "at most so many stops; 0: all")->capture_default_str();
  command.footer(
      "Data: http://asrl.utias.utoronto.ca/datasets/mrclam/. A tube's range is that to the tube: radius 0.\n"
      "Example:\n"
      "  rangecal import mrclam MRCLAM_Dataset6 --robot 2 --as pairs -o rec && rangecal calibrate rec");
  return [given] { return import_mrclam(*given); };
}

const bool kKnown =
    know_importer({"mrclam", "UTIAS multi-robot data set: camera ranges to barcode tubes", add});

}  // namespace
}  // namespace rangecal::ingest
