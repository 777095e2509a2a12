// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <vector>

#include "extract/common_radius.hpp"
#include "extract/stop_groups.hpp"

namespace rangecal::extract {

/// A cylinder in one scan.
struct Cylinder {
  int stop = 0, scan = 0;  ///< index of the stop, of the scan within it
  Segment segment;
  CircleFit fit;
  double flat_nats = 0.0;  ///< see Finding
};

struct Cylinders {
  std::vector<Cylinder> list;
  Tally beams, segments;
};

/// Segments and circles of all scans of stops, which are read for it; by stop and scan. Cost: linear in the beams; memory: that of the
/// cylinders' hits.
Cylinders find_cylinders(const AllScans& scans, const std::vector<StopGroup>& groups, const ScanNoise& noise,
                         const ExtractOptions& options);

/// The noise law that the residuals of the circles state; nothing where they have fewer than 200 degrees of freedom.
std::optional<ScanNoise> noise_of_fits(const Cylinders& found);

/// One landmark in the scans of one stop.
struct Cluster {
  Sighting sighting;                 ///< means over the scans
  std::vector<std::size_t> members;  ///< indices into Cylinders::list
};

/// Cylinders of a stop's scans that are one landmark: nearest neighbour from scan to scan, gated at five standard
/// deviations. Those found in less than `support` of the scans, and those which all scans together make out to be flat,
/// are counted in `tally` and left out.
std::vector<Cluster> cluster_by_stop(const std::vector<StopGroup>& groups, const Cylinders& found,
                                     const ExtractOptions& options, Tally& tally);

/// The radius of each landmark: of the map, the only one known, the known one that its sightings fit best, or the one that
/// all its arcs have in common (common_radius); where that has no answer, the middle one of theirs.
std::vector<RadiusEstimate> radii_of(const std::vector<Cluster>& clusters, const Association& association,
                                     const Cylinders& found, const ScanNoise& noise,
                                     const ExtractOptions& options);

/// Why a landmark, by all its sightings together, is no cylinder of its radius: one text each, empty for a cylinder.
/// Asks for five hits inside the edges, and a shape (Roundness) that is not flat and not far from round.
std::vector<const char*> reasons_for_rejection(const std::vector<Cluster>& clusters,
                                               const Association& association,
                                               const std::vector<RadiusEstimate>& radii,
                                               const Cylinders& found, const ScanNoise& noise,
                                               const CylinderOptions& options);

}  // namespace rangecal::extract
