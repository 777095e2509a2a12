// SPDX-License-Identifier: BSD-3-Clause
#include "extract/cylinders.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/solvers/extract/assignment.hpp"
#include "rangecal/solvers/extract/roundness.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::extract {
namespace {

constexpr double kGate = 25.0;      ///< squared, for one landmark from scan to scan
constexpr int kNoiseDegrees = 200;  ///< of freedom, for a noise law from the circles
constexpr int kBins = 8;
constexpr double kScanSlackM = 0.005,
                 kScanSlackRad = 0.002;  ///< the same landmark may move by this between scans

double axis_of(const CircleFit& fit) { return fit.range_m + fit.radius_m; }

double square(double x) { return x * x; }

/// A cluster that grows scan by scan.
struct Growing {
  double axis_m = 0.0, bearing_rad = 0.0;
  std::vector<std::size_t> members;

  void add(std::size_t member, const CircleFit& fit) {
    members.push_back(member);
    const double share = 1.0 / static_cast<double>(members.size());
    axis_m += share * (axis_of(fit) - axis_m);
    bearing_rad += share * wrap_angle(fit.bearing_rad - bearing_rad);
  }
  double distance(const CircleFit& fit) const {
    const double range_var = 2.0 * (square(fit.range_sd_m) + square(fit.radius_sd_m)) + square(kScanSlackM);
    const double bearing_var = 2.0 * square(fit.bearing_sd_rad) + square(kScanSlackRad);
    return square(axis_of(fit) - axis_m) / range_var +
           square(wrap_angle(fit.bearing_rad - bearing_rad)) / bearing_var;
  }
};

void place(const std::vector<std::size_t>& in_scan, const Cylinders& found, std::vector<Growing>& clusters) {
  Eigen::MatrixXd cost(static_cast<Eigen::Index>(in_scan.size()), static_cast<Eigen::Index>(clusters.size()));
  for (Eigen::Index i = 0; i < cost.rows(); ++i)
    for (Eigen::Index j = 0; j < cost.cols(); ++j) {
      const double distance = clusters[static_cast<std::size_t>(j)].distance(
          found.list[in_scan[static_cast<std::size_t>(i)]].fit);
      cost(i, j) = distance < kGate ? distance : std::numeric_limits<double>::infinity();
    }
  const std::vector<int> home = assign(cost, kGate);
  for (std::size_t i = 0; i < in_scan.size(); ++i) {
    const CircleFit& fit = found.list[in_scan[i]].fit;
    if (home[i] < 0) {
      clusters.emplace_back();
      clusters.back().bearing_rad = fit.bearing_rad;
    }
    (home[i] < 0 ? clusters.back() : clusters[static_cast<std::size_t>(home[i])]).add(in_scan[i], fit);
  }
}

Sighting sighting_of(const Growing& cluster, int stop, const Cylinders& found) {
  Sighting sighting{stop, cluster.axis_m, wrap_angle(cluster.bearing_rad), 0.0, 0.0};
  const auto n = static_cast<double>(cluster.members.size());
  for (const std::size_t m : cluster.members) {
    const CircleFit& fit = found.list[m].fit;
    sighting.range_sd_m += (square(fit.range_sd_m) + square(fit.radius_sd_m)) / (n * n);
    sighting.bearing_sd_rad += square(fit.bearing_sd_rad) / (n * n);
  }
  sighting.range_sd_m = std::sqrt(sighting.range_sd_m),
  sighting.bearing_sd_rad = std::sqrt(sighting.bearing_sd_rad);
  return sighting;
}

}  // namespace

Cylinders find_cylinders(const AllScans& scans, const std::vector<StopGroup>& groups, const ScanNoise& noise,
                         const ExtractOptions& options) {
  std::vector<std::pair<int, int>> place(scans.size(), {-1, -1});  // stop, scan within it
  for (std::size_t k = 0; k < groups.size(); ++k)
    for (std::size_t q = 0; q < groups[k].scans.size(); ++q)
      place[groups[k].scans[q]] = {static_cast<int>(k), static_cast<int>(q)};
  Cylinders found;
  scans.read([&](std::size_t i, const Scan& scan) {
    const auto [stop, within] = place[i];
    if (stop < 0) return;
    for (Segment& segment : split_scan(scan, noise, options.cylinder, found.beams)) {
      const SegmentVerdict finding = judge_segment(segment, noise, options.cylinder);
      const auto hits = static_cast<long>(segment.beams.size());
      ++found.segments["all"];
      if (finding.kind != FindingKind::cylinder) {
        const bool wall = finding.kind == FindingKind::wall;
        ++found.segments[wall ? "wall" : std::string("clutter: ") + finding.reason];
        found.beams[wall ? "on walls" : "on clutter"] += hits;
        continue;
      }
      ++found.segments["cylinder"];
      found.beams["fitted"] += finding.fit.used;
      found.beams["dropped at a cylinder's edge"] += finding.fit.edge_beams;
      found.beams["mixed pixel behind a cylinder's edge"] += finding.mixed_pixels;
      found.list.push_back({stop, within, std::move(segment), finding.fit, finding.flat_nats});
    }
  });
  std::stable_sort(found.list.begin(), found.list.end(), [](const Cylinder& a, const Cylinder& b) {
    return std::pair(a.stop, a.scan) < std::pair(b.stop, b.scan);
  });
  return found;
}

std::optional<ScanNoise> noise_of_fits(const Cylinders& found) {
  std::vector<const Cylinder*> order;
  double degrees = 0.0;
  for (const Cylinder& cylinder : found.list) {
    if (cylinder.fit.degrees_of_freedom <= 0) continue;
    order.push_back(&cylinder);
    degrees += cylinder.fit.degrees_of_freedom;
  }
  if (degrees < kNoiseDegrees) return std::nullopt;
  std::sort(order.begin(), order.end(),
            [](const Cylinder* a, const Cylinder* b) { return a->fit.range_m < b->fit.range_m; });
  std::vector<SpreadSample> samples;
  double sum = 0.0, r4 = 0.0, dof = 0.0;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const CircleFit& fit = order[i]->fit;
    sum += fit.chi_squared * square(fit.mean_sd_m) * fit.used;  // mean_sd_m^2 used = sigma^2 of one beam
    r4 += fit.degrees_of_freedom * std::pow(fit.range_m, 4), dof += fit.degrees_of_freedom;
    if (dof < degrees / kBins && i + 1 < order.size()) continue;
    samples.push_back({std::pow(r4 / dof, 0.25), sum / dof, dof});
    sum = r4 = dof = 0.0;
  }
  return fit_scan_noise(samples);
}

std::vector<Cluster> cluster_by_stop(const std::vector<StopGroup>& groups, const Cylinders& found,
                                     const ExtractOptions& options, Tally& tally) {
  std::vector<Cluster> out;
  std::size_t next = 0;  // the list is in the order of stop and scan
  for (std::size_t k = 0; k < groups.size(); ++k) {
    std::vector<Growing> clusters;
    while (next < found.list.size() && found.list[next].stop == static_cast<int>(k)) {
      std::vector<std::size_t> in_scan;
      const int scan = found.list[next].scan;
      while (next < found.list.size() && found.list[next].stop == static_cast<int>(k) &&
             found.list[next].scan == scan)
        in_scan.push_back(next++);
      place(in_scan, found, clusters);
    }
    for (const Growing& cluster : clusters) {
      double flat_nats = 0.0;
      for (const std::size_t m : cluster.members) flat_nats += found.list[m].flat_nats;
      const auto count = static_cast<double>(cluster.members.size());
      if (count < options.support * static_cast<double>(groups[k].scans.size())) {
        tally["in too few scans of the stop"] += static_cast<long>(cluster.members.size());
      } else if (flat_nats > options.cylinder.flat_nats * std::sqrt(count)) {
        tally["flat, all scans of the stop together"] += static_cast<long>(cluster.members.size());
      } else {
        out.push_back({sighting_of(cluster, static_cast<int>(k), found), cluster.members});
      }
    }
  }
  return out;
}

namespace {

using Members = std::vector<std::vector<std::size_t>>;  ///< indices into Cylinders::list, cluster by cluster

std::vector<Members> members_of_landmarks(const std::vector<Cluster>& clusters,
                                          const Association& association) {
  std::vector<Members> members(association.landmarks.size());
  for (std::size_t c = 0; c < clusters.size(); ++c)
    if (association.landmark[c] >= 0)
      members[static_cast<std::size_t>(association.landmark[c])].push_back(clusters[c].members);
  return members;
}

/// The arc of a segment, its mixed pixels dropped by a circle of the radius; an end that is hidden tells no axis, there it is
/// that of the circle.
std::optional<Arc> arc_of(const Segment& segment, const ScanNoise& noise, const CylinderOptions& options,
                          double radius_m) {
  Segment cleaned;
  const auto fit = refit_segment(segment, noise, options, radius_m, &cleaned);
  if (!fit) return std::nullopt;
  Arc arc;
  arc.outline = outline_of(cleaned.miss_left_rad, cleaned.beams.front().bearing_rad,
                           cleaned.beams.back().bearing_rad, cleaned.miss_right_rad);
  if (cleaned.nearer_left || cleaned.nearer_right)
    arc.outline.centre_rad = fit->bearing_rad, arc.outline.centre_sd_rad = fit->bearing_sd_rad;
  arc.range_m = fit->range_m, arc.sigma_m = noise.spread(fit->range_m);
  arc.beams = std::move(cleaned.beams);
  return arc;
}

RadiusEstimate estimated_radius(const Members& members, const Cylinders& found, const ScanNoise& noise,
                                const CylinderOptions& options) {
  std::vector<double> each, sds;
  for (const auto& cluster : members)
    for (const std::size_t m : cluster) {
      each.push_back(found.list[m].fit.radius_m);
      sds.push_back(found.list[m].fit.radius_sd_m);
    }
  if (each.empty()) return {};
  const RadiusEstimate middle{upper_median(std::move(each)), upper_median(std::move(sds))};
  std::vector<std::vector<Arc>> stops;
  for (const auto& cluster : members) {
    std::vector<Arc> arcs;
    for (const std::size_t m : cluster)
      if (auto arc = arc_of(found.list[m].segment, noise, options, middle.radius_m))
        arcs.push_back(std::move(*arc));
    if (!arcs.empty()) stops.push_back(std::move(arcs));
  }
  return common_radius(stops, middle.radius_m, {options.edge_cut, options.radius_min_m, options.radius_max_m})
      .value_or(middle);
}

/// The one of several known radii that the sightings speak for.
double known_radius(const Members& members, const Cylinders& found, const ScanNoise& noise,
                    const CylinderOptions& options) {
  double best = options.radii_m.front(), least = std::numeric_limits<double>::infinity();
  for (const double radius : options.radii_m) {
    double misfit = 0.0;
    for (const auto& cluster : members)
      for (const std::size_t m : cluster)  // one odd scan must not outvote the others
        misfit += std::min(radius_misfit(found.list[m].segment, noise, options, radius), 50.0);
    if (misfit < least) best = radius, least = misfit;
  }
  return best;
}

}  // namespace

std::vector<RadiusEstimate> radii_of(const std::vector<Cluster>& clusters, const Association& association,
                                     const Cylinders& found, const ScanNoise& noise,
                                     const ExtractOptions& options) {
  const CylinderOptions& cylinder = options.cylinder;
  const std::vector<Members> members = members_of_landmarks(clusters, association);
  std::vector<RadiusEstimate> radii;
  for (std::size_t j = 0; j < members.size(); ++j) {
    if (!options.map.empty() && options.map[j].radius_m)
      radii.push_back({*options.map[j].radius_m, 0.0});
    else if (cylinder.radii_m.empty())
      radii.push_back(estimated_radius(members[j], found, noise, cylinder));
    else if (cylinder.radii_m.size() == 1)
      radii.push_back({cylinder.radii_m.front(), 0.0});
    else
      radii.push_back({known_radius(members[j], found, noise, cylinder), 0.0});
  }
  return radii;
}

std::vector<const char*> reasons_for_rejection(const std::vector<Cluster>& clusters,
                                               const Association& association,
                                               const std::vector<RadiusEstimate>& radii,
                                               const Cylinders& found, const ScanNoise& noise,
                                               const CylinderOptions& options) {
  std::vector<Roundness> shapes(association.landmarks.size());
  for (std::size_t c = 0; c < clusters.size(); ++c) {
    if (association.landmark[c] < 0) continue;
    const auto j = static_cast<std::size_t>(association.landmark[c]);
    for (const std::size_t m : clusters[c].members) {
      const Segment& segment = found.list[m].segment;
      if (const auto fit = refit_segment(segment, noise, options, radii[j].radius_m))
        shapes[j].add(segment.beams, *fit, noise.spread(fit->range_m), options.edge_cut);
    }
  }
  std::vector<const char*> reasons;
  for (const Roundness& each : shapes) {
    const Roundness::Shape shape = each.shape();
    const double slack = options.round_slack, sigmas = options.round_sigmas;
    if (each.most_hits() < options.hits_min)
      reasons.push_back("too few hits inside its edges, in all scans");
    else if (shape.bow < sigmas * shape.bow_sd)
      reasons.push_back("no curvature shows, all scans together");
    else if (std::abs(shape.bow - 1.0) > slack + sigmas * shape.bow_sd ||
             std::abs(shape.lean) > slack + sigmas * shape.lean_sd)
      reasons.push_back("not round, all scans together");
    else
      reasons.push_back("");
  }
  return reasons;
}

}  // namespace rangecal::extract
