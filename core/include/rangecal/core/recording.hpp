// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <limits>
#include <map>
#include <optional>
#include <string>
#include <vector>

namespace rangecal {

/// What a recording holds: see docs/formats.md (kind `landmarks`: the 2021 problem; kind `pairs`: the 2016 problem).
enum class RecordingKind { landmarks, pairs };

/// How the errors of the stops relate: independent, or accumulated from stop to stop.
enum class StopErrorModel { independent, random_walk };

struct Sensor {
  std::string name, principle;
  double range_min_m = 0.0;
  double range_max_m = std::numeric_limits<double>::infinity();
  std::string unit = {};  ///< of readings that are no lengths ("V"); empty: metres
};

/// A pose in the plane: position [m] and heading [rad], counter-clockwise from x.
struct Pose2 {
  double x_m = 0.0, y_m = 0.0, heading_rad = 0.0;
};

/// One stop: where the robot was commanded to be (or odometry said it was) and how far it may be from there.
struct Stop {
  std::string label;  ///< the column `stop`
  Pose2 commanded;
  std::optional<double> sigma_xy_m;  ///< own column; otherwise the recording's
  std::optional<double> sigma_heading_rad;
  std::string place;  ///< stops with the same non-empty place share one position error
  /// In place of both sigmas: covariance of the error in (x, y, heading) [m^2, m rad, rad^2], in the world's frame; along
  /// a random walk that of the step to this stop, in the frame of the stop before.
  std::optional<Eigen::Matrix3d> covariance;
};

struct Landmark {
  std::string label;
  double radius_m = 0.0;
  std::optional<double> reflectance;
};

/// A taped distance from landmark to landmark, axis to axis [m].
struct KnownDistance {
  int from = 0, to = 0;  ///< indices into Recording::landmarks
  double distance_m = 0.0, sigma_m = 0.0;
};

/// Columns that the file holds besides the known ones, by name; one value per reading, NaN where a field is empty.
using Covariates = std::map<std::string, std::vector<double>>;

/// What a covariate column measures, as far as an effect of the catalogue asks for it.
enum class ColumnRole { received_power, temperature, azimuth, elevation, supply_voltage, intensity, other };
/// "received_power", "temperature", ...
const char* to_string(ColumnRole role);
ColumnRole column_role_from_string(const std::string& text);

/// A covariate column: what it measures, and in which unit ("" where that is not known).
struct Column {
  ColumnRole role = ColumnRole::other;
  std::string unit;
};

/// What the name of a column says of it: "temperature_c" is a temperature in degrees Celsius, "rx_power_dbm" a received
/// power in dBm, "supply_v" a supply voltage in volts. A name that says nothing is of role `other`.
Column column_by_name(const std::string& name);

/// Readings of kind `landmarks`, structure of arrays, in the order of the file. Only usable readings are held.
struct Readings {
  std::vector<int> stop, landmark;  ///< indices into Recording::stops, ::landmarks
  std::vector<int> repeat;          ///< as in the file, or counted within (stop, landmark) in file order
  std::vector<double> time_s;       ///< empty if the file has no such column
  std::vector<double> range_m;
  std::vector<double> bearing_rad;  ///< empty if the file has no such column: ranges alone (radio, sonar)
  std::vector<int> row;             ///< line in observations.csv (header = 1)
  Covariates covariates;

  std::size_t size() const { return range_m.size(); }
  bool has_bearings() const { return bearing_rad.size() == range_m.size(); }
};

/// Readings of kind `pairs`, structure of arrays, in the order of the file.
struct Pairs {
  std::vector<double> true_m, reading_m;
  std::vector<int> batch;  ///< index of the batch, -1 for none; empty if the file has no such column
  std::vector<std::string> batch_labels;
  std::vector<int> landmark;  ///< index into Recording::landmarks; empty if the file has no such column
  std::vector<double> time_s, bearing_rad;  ///< empty if the file has no such column
  std::vector<int> row;                     ///< line in pairs.csv (header = 1)
  Covariates covariates;

  std::size_t size() const { return reading_m.size(); }
};

/// Which readings belong together (`group_by:` of recording.yaml): those of one trial, of one day, of one place of the tag.
/// What is held out is held out by whole groups.
struct Groups {
  std::vector<std::string> by;  ///< the columns that tell; empty: no groups are stated
  std::vector<int> of;          ///< group of every reading, from 0 in the order of first readings
  std::vector<std::vector<std::string>> labels;  ///< of every group: its text in each column of `by`

  bool stated() const { return !by.empty(); }
};

/// How well the true distances of pairs are known (`reference:` of recording.yaml).
struct Reference {
  double sigma_m =
      0.0;  ///< standard deviation of a stated distance, one error for all readings of a setting [m]
};

/// What was read and what could not be used, and why. Nothing is dropped silently.
struct Counts {
  int read = 0, used = 0;
  std::map<std::string, int> dropped;  ///< reason -> readings: "missing", "not finite", "zero", "negative",
                                       ///< "below range_min_m", "above range_max_m", "cell cut by a limit"
  int cells_left_out = 0;              ///< cells of which more than 1 % was lost at a limit of the sensor
};

/// "10 missing, 2 zero": why readings were dropped, the most frequent reason first; empty where none was.
std::string dropped_in_words(const Counts& counts);

/// Ground truth, where a recording has any. Never read by an estimator, only by scoring.
struct Truth {
  std::vector<std::optional<Pose2>> stops;                ///< per stop of the recording
  std::vector<std::optional<Eigen::Vector2d>> landmarks;  ///< per landmark of the recording
};

/// A recording in memory. Landmarks are ordered by first appearance in landmarks.csv, then in the observations.
struct Recording {
  std::string path;  ///< folder it was read from; empty if made in memory
  RecordingKind kind = RecordingKind::landmarks;
  Sensor sensor;

  double sigma_xy_m = 0.01;        ///< default of the stops; ignored where estimate_sigma_xy
  bool estimate_sigma_xy = false;  ///< `sigma_xy_m: estimate`
  double sigma_heading_rad = 0.0;  ///< 0: headings are exact
  StopErrorModel stop_error = StopErrorModel::independent;
  std::vector<Stop> stops;
  std::vector<Landmark> landmarks;
  std::vector<KnownDistance> known_distances;

  Readings readings;  ///< kind landmarks
  Pairs pairs;        ///< kind pairs
  Groups groups;
  Reference reference;  ///< kind pairs
  Counts counts;
  Truth truth;

  /// `columns:` of recording.yaml: what covariate columns are where their names do not say it.
  std::map<std::string, Column> columns;

  /// `extraction:` of recording.yaml, how the readings were cut out of raw scans: each field's text, a list as YAML.
  /// "arc" is which point of a cylinder's arc was taken for the range.
  std::map<std::string, std::string> extraction;

  /// What the reader did that a person should know, a sentence each: a column left out for a text among its numbers, pairs
  /// whose distances do not repeat. Empty if made in memory; never written. Cut-down copies keep them.
  std::vector<std::string> notes;
};

/// The covariate columns of its readings, of either kind.
inline const Covariates& covariates_of(const Recording& recording) {
  return recording.kind == RecordingKind::pairs ? recording.pairs.covariates : recording.readings.covariates;
}
inline Covariates& covariates_of(Recording& recording) {
  return recording.kind == RecordingKind::pairs ? recording.pairs.covariates : recording.readings.covariates;
}

/// What the covariate column of that name is: as stated, else as its name says.
Column column_of(const Recording& recording, const std::string& name);

/// How far `stop` may be from its commanded place per axis [m]; of a covariance the root mean square of both axes.
inline double sigma_xy_of(const Recording& recording, const Stop& stop) {
  if (stop.covariance) return std::sqrt(0.5 * stop.covariance->topLeftCorner<2, 2>().trace());
  return stop.sigma_xy_m.value_or(recording.sigma_xy_m);
}

/// The same of its heading [rad].
inline double sigma_heading_of(const Recording& recording, const Stop& stop) {
  if (stop.covariance) return std::sqrt((*stop.covariance)(2, 2));
  return stop.sigma_heading_rad.value_or(recording.sigma_heading_rad);
}

}  // namespace rangecal
