// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/extract/extract.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>
#include <utility>

#include "extract/all_scans.hpp"
#include "extract/cylinders.hpp"
#include "extract/stop_groups.hpp"
#include "extract/thinned.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

constexpr auto arc_rule_names = names_of<ArcRule>(
    "point of the arc",
    {{ArcRule::nearest, "nearest"}, {ArcRule::mean, "mean"}, {ArcRule::smallest, "smallest"}});

constexpr auto stop_split_names =
    names_of<StopSplit>("what tells stops apart", {{StopSplit::automatic, "automatic"},
                                                   {StopSplit::label, "label"},
                                                   {StopSplit::file, "file"},
                                                   {StopSplit::scan, "scan"},
                                                   {StopSplit::standing, "standing"}});

using namespace extract;

void add_returns(const Scan& scan, Thinned<double>& returns) {
  for (const double range : scan.range_m)
    if (Scan::returned(range) && returns.next()) returns.keep(range);
}

/// How badly an association explains the sightings: distances, and a gate for each landmark and each one left over.
double burden(const Association& association, double gate) {
  const auto alone = static_cast<double>(association.landmark.size()) - association.matched;
  return association.cost + gate * (static_cast<double>(association.landmarks.size()) + alone);
}

/// True if the stops are explained clearly better with all bearings reversed.
bool reversed_fits_better(const std::vector<Pose2>& poses, std::vector<Sighting> sightings,
                          const AssociationOptions& options, const Association& as_given) {
  for (Sighting& sighting : sightings) sighting.bearing_rad = -sighting.bearing_rad;
  const Association other = associate(poses, sightings, options);
  return burden(other, options.gate) + 3.0 * options.gate < 0.7 * burden(as_given, options.gate);
}

double reading_of(const CircleFit& fit, ArcRule rule) {
  if (rule == ArcRule::mean) return fit.mean_m;
  return rule == ArcRule::smallest ? fit.smallest_m : fit.range_m;
}

double reading_sd_of(const CircleFit& fit, ArcRule rule, double sigma) {
  if (rule == ArcRule::mean) return fit.mean_sd_m;
  return rule == ArcRule::smallest ? sigma : fit.range_sd_m;
}

void add_reading(Recording& recording, int stop, int landmark, int repeat, double time_s,
                 const CircleFit& fit, ArcRule arc, double sigma) {
  Readings& readings = recording.readings;
  readings.stop.push_back(stop), readings.landmark.push_back(landmark), readings.repeat.push_back(repeat);
  readings.time_s.push_back(time_s);
  readings.range_m.push_back(reading_of(fit, arc));
  readings.bearing_rad.push_back(wrap_angle(fit.bearing_rad));
  readings.row.push_back(static_cast<int>(readings.size()) + 1);
  readings.covariates["beams"].push_back(fit.used);
  readings.covariates[range_sd_column].push_back(reading_sd_of(fit, arc, sigma));
  readings.covariates[bearing_sd_column].push_back(fit.bearing_sd_rad);
}

/// The landmarks of the recording in the order of their first reading, and the new index of each.
std::vector<int> name_landmarks(const std::vector<Cluster>& clusters, const Association& association,
                                const std::vector<RadiusEstimate>& radii, const ExtractOptions& options,
                                Extraction& extraction) {
  std::vector<int> index(association.landmarks.size(), -1);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    if (association.landmark[c] < 0) continue;
    const auto j = static_cast<std::size_t>(association.landmark[c]);
    if (index[j] >= 0) continue;
    index[j] = static_cast<int>(extraction.recording.landmarks.size());
    const std::string label = options.map.empty() ? "L" + std::to_string(index[j] + 1) : options.map[j].label;
    extraction.recording.landmarks.push_back({label, radii[j].radius_m, std::nullopt});
    extraction.radius_sd_m.push_back(radii[j].sd_m);
    extraction.landmark_positions.push_back(association.landmarks[j]);
  }
  return index;
}

/// True if the refined noise is not above the first at the circles' ranges. Walls never state too little, so more than
/// they say means that things are among the circles that are none.
bool is_below(const ScanNoise& refined, const ScanNoise& first, const Cylinders& found) {
  double above = 0.0;
  for (const Cylinder& cylinder : found.list)
    above += std::log(refined.spread(cylinder.fit.range_m) / first.spread(cylinder.fit.range_m));
  return above < 0.15 * static_cast<double>(found.list.size());
}

std::vector<Sighting> sightings_of(const std::vector<Cluster>& clusters) {
  std::vector<Sighting> sightings;
  for (const Cluster& cluster : clusters) sightings.push_back(cluster.sighting);
  return sightings;
}

/// Takes out the clusters of landmarks that are no cylinders; true if there were any.
bool leave_out_rejected(std::vector<Cluster>& clusters, const Association& association,
                        const Cylinders& found, const ScanNoise& noise, const ExtractOptions& options,
                        Tally& tally) {
  const std::vector<RadiusEstimate> radii = radii_of(clusters, association, found, noise, options);
  const auto reasons = reasons_for_rejection(clusters, association, radii, found, noise, options.cylinder);
  std::vector<Cluster> kept;
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    const int j = association.landmark[c];
    const std::string reason = j < 0 ? "" : reasons[static_cast<std::size_t>(j)];
    if (reason.empty())
      kept.push_back(clusters[c]);
    else
      tally[reason] += static_cast<long>(clusters[c].members.size());
  }
  const bool any = kept.size() < clusters.size();
  clusters = std::move(kept);
  return any;
}

AssociationOptions association_options(const ExtractOptions& options) {
  AssociationOptions association = options.association;
  // Poses may be exact; for the matching a centimetre and a third of a degree are left open.
  association.sigma_xy_m = std::max(association.sigma_xy_m, 0.01);
  association.sigma_heading_rad = std::max(association.sigma_heading_rad, 0.006);
  for (const MappedLandmark& landmark : options.map) association.map.push_back(landmark.position);
  return association;
}

void set_up(Recording& recording, const std::vector<StopGroup>& groups, const ExtractOptions& options) {
  recording.kind = RecordingKind::landmarks;
  recording.sigma_xy_m = options.association.sigma_xy_m;
  recording.sigma_heading_rad = options.association.sigma_heading_rad;
  recording.stop_error = options.association.error;
  recording.sensor.range_min_m = options.cylinder.range_min_m;
  recording.sensor.range_max_m = options.cylinder.range_max_m;
  for (const StopGroup& group : groups) recording.stops.push_back(group.stop);
}

}  // namespace

const char* to_string(ArcRule rule) { return arc_rule_names.name_of(rule); }

ArcRule arc_rule_from_string(const std::string& text) { return arc_rule_names.value_of(text); }

const char* to_string(StopSplit split) { return stop_split_names.name_of(split); }

StopSplit stop_split_from_string(const std::string& text) { return stop_split_names.value_of(text); }

Extraction extract_recording(std::vector<ScanLog> logs, const std::vector<Stop>& stops,
                             const ExtractOptions& options) {
  std::vector<ScansInMemory> in_memory(std::move_iterator(logs.begin()), std::move_iterator(logs.end()));
  std::vector<ScanSource*> sources;
  for (ScansInMemory& one : in_memory) sources.push_back(&one);
  return extract_recording(sources, stops, options);
}

Extraction extract_recording(std::span<ScanSource* const> sources, const std::vector<Stop>& stops,
                             const ExtractOptions& options) {
  if (sources.empty()) throw InputError("no file of scans is given");
  Extraction out;
  AllScans scans(sources, options.clockwise);
  ScanNoiseEstimator from_walls;
  Thinned<double> returns{100'000};
  scans.survey([&](const Scan& scan) {
    if (!options.noise) from_walls.add(scan);
    add_returns(scan, returns);
  });
  if (scans.size() == 0) throw InputError(scans.logs().front()->path, 0, "", "holds no scan");
  if (!returns.kept().empty()) out.median_return_m = upper_median(returns.kept());
  out.noise = options.noise ? *options.noise : from_walls.estimate();
  out.noise_origin = options.noise ? "given" : "from walls";
  out.split = resolved_split(scans, stops, options.split);
  out.scans["read"] = static_cast<long>(scans.size());
  const std::vector<StopGroup> groups = group_by_stop(scans, stops, out.noise, options, out.split, out.scans);

  Cylinders found = find_cylinders(scans, groups, out.noise, options);
  if (!options.noise) {
    const auto refined = noise_of_fits(found);
    if (refined && is_below(*refined, out.noise, found)) {
      out.noise = *refined, out.noise_origin = "from the circles";
      found = find_cylinders(scans, groups, out.noise, options);
    }
  }
  out.beams = found.beams, out.segments = found.segments;
  out.cylinders["found"] = static_cast<long>(found.list.size());

  std::vector<Cluster> clusters = cluster_by_stop(groups, found, options, out.cylinders);
  std::vector<Pose2> poses;
  for (const StopGroup& group : groups) poses.push_back(group.stop.commanded);
  const AssociationOptions matching = association_options(options);
  Association association = associate(poses, sightings_of(clusters), matching);
  if (options.map.empty() &&
      leave_out_rejected(clusters, association, found, out.noise, options, out.cylinders))
    association = associate(poses, sightings_of(clusters), matching);
  out.corrected_stops = association.stops;
  out.runs_clockwise =
      poses.size() > 1 && reversed_fits_better(poses, sightings_of(clusters), matching, association);

  const std::vector<RadiusEstimate> radii = radii_of(clusters, association, found, out.noise, options);
  set_up(out.recording, groups, options);
  const std::vector<int> index = name_landmarks(clusters, association, radii, options, out);
  double start = scans.head(0).stamp_s;
  for (std::size_t i = 1; i < scans.size(); ++i) start = std::min(start, scans.head(i).stamp_s);
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    if (association.landmark[c] < 0) {
      out.cylinders[association.reason[c]] += static_cast<long>(clusters[c].members.size());
      continue;
    }
    const auto j = static_cast<std::size_t>(association.landmark[c]);
    for (const std::size_t m : clusters[c].members) {
      const Cylinder& cylinder = found.list[m];
      const auto fit = refit_segment(cylinder.segment, out.noise, options.cylinder, radii[j].radius_m);
      if (!fit) {
        ++out.cylinders["no circle of its landmark's radius"];
        continue;
      }
      const Scan& scan = scans.head(
          groups[static_cast<std::size_t>(cylinder.stop)].scans[static_cast<std::size_t>(cylinder.scan)]);
      add_reading(out.recording, cylinder.stop, index[j], cylinder.scan, scan.stamp_s - start, *fit,
                  options.arc, out.noise.spread(fit->range_m));
      ++out.cylinders["used"];
    }
  }
  out.recording.counts.read = out.recording.counts.used = static_cast<int>(out.recording.readings.size());
  return out;
}

}  // namespace rangecal
