// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/core/scan.hpp"
#include "rangecal/solvers/extract/association.hpp"
#include "rangecal/solvers/extract/scan_source.hpp"
#include "rangecal/solvers/extract/segments.hpp"
#include "rangecal/solvers/extract/stands.hpp"

namespace rangecal {

/// Which point of the arc is "the range"; an effect of its own (`arc_definition`).
enum class ArcRule {
  nearest,  ///< the nearest point of the fitted circle
  mean,     ///< the mean of the hits fitted: about 0.2 R farther
  smallest  ///< the smallest hit: nearer by the noise's extreme
};
const char* to_string(ArcRule rule);
ArcRule arc_rule_from_string(const std::string& text);  ///< throws InputError naming the accepted texts

/// What tells the stops of a log apart.
enum class StopSplit {
  automatic,  ///< stop labels if the scans have any; else one file a stop if there are several files and as many as stops; else standing
  label,      ///< the column `stop` of the scans
  file,       ///< each file is a stop
  scan,       ///< each scan is a stop
  standing    ///< each stretch of time in which the robot stands
};
const char* to_string(StopSplit split);
StopSplit stop_split_from_string(const std::string& text);

/// A landmark whose place is known.
struct MappedLandmark {
  std::string label;
  Eigen::Vector2d position = Eigen::Vector2d::Zero();
  std::optional<double> radius_m;
};

struct ExtractOptions {
  CylinderOptions cylinder;
  std::optional<ScanNoise> noise;  ///< of one beam; estimated from the scans where it is not given
  ArcRule arc = ArcRule::nearest;
  StopSplit split = StopSplit::automatic;
  StandOptions stand;
  AssociationOptions association;   ///< for matching; its error model and sigmas are also written into the recording
  double support = 0.5;             ///< share of a stop's scans in which a landmark must be found
  bool clockwise = false;           ///< bearings of the scans run clockwise
  std::vector<MappedLandmark> map;  ///< known landmarks; empty: found, named L1, L2, ...
};

/// Covariate columns with the standard deviations of range and bearing by the fit of the circle; `diagnose` drops them before it looks for
/// effects.
inline constexpr const char* range_sd_column = "range_sd_m";
inline constexpr const char* bearing_sd_column = "bearing_sd_rad";

struct Extraction {
  Recording recording;  ///< kind landmarks; covariates beams, range_sd_column, bearing_sd_column
  ScanNoise noise;
  std::string noise_origin;  ///< "given", "from walls", "from the circles"
  StopSplit split = StopSplit::automatic;
  Tally scans, beams, segments, cylinders;  ///< what became of each, and why
  std::vector<Pose2>
      corrected_stops;  ///< where the landmarks put the stops (not in the recording: nothing is corrected)
  std::vector<Eigen::Vector2d> landmark_positions;
  std::vector<double> radius_sd_m;  ///< of each landmark's radius, where it was estimated; else 0
  double median_return_m = 0.0;     ///< of the returned ranges, of an even sample of some 100 000 where there are more; 0 if none
  bool runs_clockwise = false;      ///< the opposite of options.clockwise fits the stops clearly better
};

/// From scans to a recording: stops, noise, segments, circles, labels, readings, in this order; see the headers beside.
/// `stops`: their poses; where empty, the odometry of the scans, or the origin for a single stop. Landmarks are
/// labelled by the map or in the order of first sight; with several or no known radii each landmark gets the one that
/// its sightings speak for, and all of them are fitted again with it. Throws InputError where stops and scans do not
/// agree. Cost: linear in the beams, for the association see there.
///
/// Every source, which must be unread, is read two to four times: for the noise, for stands (unless all scans have odometry), for cylinders,
/// and once more if the circles give a better noise. Memory: heads of the scans and the hits of cylinders.
Extraction extract_recording(std::span<ScanSource* const> sources, const std::vector<Stop>& stops,
                             const ExtractOptions& options);
/// The same of logs in memory.
Extraction extract_recording(std::vector<ScanLog> logs, const std::vector<Stop>& stops,
                             const ExtractOptions& options);

}  // namespace rangecal
