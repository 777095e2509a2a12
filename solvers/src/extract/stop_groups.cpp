// SPDX-License-Identifier: BSD-3-Clause
#include "extract/stop_groups.hpp"

#include <algorithm>
#include <map>
#include <string>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal::extract {
namespace {

using Groups = std::vector<std::vector<std::size_t>>;

Groups by_label(const AllScans& scans, std::vector<std::string>& labels, Tally& tally) {
  Groups groups;
  std::map<std::string, std::size_t> index;
  for (std::size_t i = 0; i < scans.size(); ++i) {
    const std::string& label = scans.head(i).stop;
    if (label.empty()) {
      ++tally["without a stop"];
      continue;
    }
    const auto [found, is_new] = index.emplace(label, groups.size());
    if (is_new) groups.emplace_back(), labels.push_back(label);
    groups[found->second].push_back(i);
  }
  return groups;
}

Groups by_file(const AllScans& scans) {
  Groups groups;
  std::size_t next = 0;
  for (const ScanLog* log : scans.logs()) {
    groups.emplace_back();
    for (std::size_t i = 0; i < log->scans.size(); ++i) groups.back().push_back(next++);
  }
  return groups;
}

Groups by_scan(const AllScans& scans) {
  Groups groups;
  for (std::size_t i = 0; i < scans.size(); ++i) groups.push_back({i});
  return groups;
}

Groups by_standing(const AllScans& scans, const ScanNoise& noise, const StandOptions& options, Tally& tally) {
  StandFinder finder(noise, options);
  bool all_have_odometry = true;
  for (std::size_t i = 0; i < scans.size(); ++i)
    all_have_odometry = all_have_odometry && scans.head(i).odometry.has_value();
  if (all_have_odometry)
    for (std::size_t i = 0; i < scans.size(); ++i) finder.add(scans.head(i));
  else
    scans.read([&](std::size_t, const Scan& scan) { finder.add(scan); });
  Groups groups = std::move(finder).stands();
  std::size_t used = 0;
  for (const auto& group : groups) used += group.size();
  if (used < scans.size()) tally["moving"] = static_cast<long>(scans.size() - used);
  return groups;
}

/// Poses for groups that have no stops file: the log's odometry, or the origin for a single stop.
std::vector<Stop> own_stops(const AllScans& scans, const Groups& groups,
                            const std::vector<std::string>& labels, const std::string& file) {
  std::vector<Stop> stops;
  for (std::size_t k = 0; k < groups.size(); ++k) {
    Stop stop;
    stop.label = labels.empty() ? std::to_string(k + 1) : labels[k];
    if (const auto& odometry = scans.head(groups[k].front()).odometry) {
      stop.commanded = *odometry;
    } else if (groups.size() > 1) {
      throw InputError(
          file, 0, "",
          "the scans stand at " + std::to_string(groups.size()) +
              " stops and carry no odometry: give their poses by a stops file (--stops), or a bag's topic of odometry (--odom)");
    }
    stops.push_back(stop);
  }
  return stops;
}

}  // namespace

StopSplit resolved_split(const AllScans& scans, const std::vector<Stop>& stops, StopSplit split) {
  if (split != StopSplit::automatic) return split;
  for (std::size_t i = 0; i < scans.size(); ++i)
    if (!scans.head(i).stop.empty()) return StopSplit::label;
  const std::size_t files = scans.logs().size();
  return files > 1 && files == stops.size() ? StopSplit::file : StopSplit::standing;
}

std::vector<StopGroup> group_by_stop(const AllScans& scans, const std::vector<Stop>& stops,
                                     const ScanNoise& noise, const ExtractOptions& options, StopSplit split,
                                     Tally& tally) {
  std::vector<std::string> labels;
  Groups groups = split == StopSplit::label  ? by_label(scans, labels, tally)
                  : split == StopSplit::file ? by_file(scans)
                  : split == StopSplit::scan ? by_scan(scans)
                                             : by_standing(scans, noise, options.stand, tally);
  const std::string& file = scans.logs().front()->path;
  if (groups.empty())
    throw InputError(
        file, 0, "",
        "no stop is found: the robot never stands for " + std::to_string(options.stand.scans_min) + " scans");
  for (const auto& group : groups) tally["used"] += static_cast<long>(group.size());

  std::vector<Stop> poses = stops;
  if (stops.empty()) {
    poses = own_stops(scans, groups, labels, file);
  } else if (split == StopSplit::label) {
    poses.clear();
    for (std::size_t k = 0; k < groups.size(); ++k) {
      const auto same = [&](const Stop& stop) { return stop.label == labels[k]; };
      const auto found = std::find_if(stops.begin(), stops.end(), same);
      if (found == stops.end())
        throw InputError(file, scans.head(groups[k].front()).row, "stop",
                         "'" + labels[k] + "' is not in the stops file");
      poses.push_back(*found);
    }
  } else if (groups.size() != stops.size()) {
    const char* what = split == StopSplit::file   ? " files"
                       : split == StopSplit::scan ? " scans"
                                                  : " stands of the robot";
    throw InputError(file, 0, "",
                     "holds " + std::to_string(groups.size()) + what + ", the stops file " +
                         std::to_string(stops.size()) + " stops");
  }
  std::vector<StopGroup> out;
  for (std::size_t k = 0; k < groups.size(); ++k) out.push_back({poses[k], std::move(groups[k])});
  return out;
}

}  // namespace rangecal::extract
