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
  automatic,  ///< labels if the scans have any; files if there are as many as stops, and several; else standing
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
  AssociationOptions association;   ///< error model and sigmas are those of the recording too
  double support = 0.5;             ///< share of a stop's scans in which a landmark must be found
  bool clockwise = false;           ///< bearings of the scans run clockwise
  std::vector<MappedLandmark> map;  ///< known landmarks; empty: found, named L1, L2, ...
};

/// Columns of the recording: how uncertain the fitted circle has a reading, no physics of its own.
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
  double median_return_m = 0.0;     ///< of all ranges (of many, of an even choice); 0 where nothing returned
  bool runs_clockwise = false;      ///< the other sense of rotation fits the stops clearly better
};

/// From scans to a recording: stops, noise, segments, circles, labels, readings, in this order; see the headers beside.
/// `stops`: their poses; where empty, the odometry of the scans, or the origin for a single stop. Landmarks are
/// labelled by the map or in the order of first sight; with several or no known radii each landmark gets the one that
/// its sightings speak for, and all of them are fitted again with it. Throws InputError where stops and scans do not
/// agree. Cost: linear in the beams, for the association see there.
///
/// The sources, which nobody has read yet, are read two to four times: for the noise, for stands (not where all scans have odometry),
/// and for cylinders, again where these tell the noise better. Memory: heads of the scans and the hits of cylinders.
Extraction extract_recording(std::span<ScanSource* const> sources, const std::vector<Stop>& stops,
                             const ExtractOptions& options);
/// The same of logs in memory.
Extraction extract_recording(std::vector<ScanLog> logs, const std::vector<Stop>& stops,
                             const ExtractOptions& options);

}  // namespace rangecal
