// SPDX-License-Identifier: BSD-3-Clause
#include "extract/stop_groups.hpp"

#include <algorithm>
#include <map>
#include <string>

#include "rangecal/core/errors.hpp"

namespace rangecal::extract {
namespace {

using Groups = std::vector<std::vector<const Scan*>>;

Groups by_label(const std::vector<ScanLog>& logs, std::vector<std::string>& labels, Tally& tally) {
  Groups groups;
  std::map<std::string, std::size_t> index;
  for (const ScanLog& log : logs)
    for (const Scan& scan : log.scans) {
      if (scan.stop.empty()) {
        ++tally["without a stop"];
        continue;
      }
      const auto [found, is_new] = index.emplace(scan.stop, groups.size());
      if (is_new) groups.emplace_back(), labels.push_back(scan.stop);
      groups[found->second].push_back(&scan);
    }
  return groups;
}

Groups by_standing(const std::vector<ScanLog>& logs, const ScanNoise& noise, const StandOptions& options,
                   Tally& tally) {
  Groups groups;
  std::vector<Scan> joined;
  const std::span<const Scan> scans = scans_of(logs, joined);
  std::vector<const Scan*> own;  // as they stand in their logs
  for (const ScanLog& log : logs)
    for (const Scan& scan : log.scans) own.push_back(&scan);
  long used = 0;
  for (const auto& stand : find_stands(scans, noise, options)) {
    groups.emplace_back();
    for (const std::size_t k : stand) groups.back().push_back(own[k]);
    used += static_cast<long>(stand.size());
  }
  const long moving = static_cast<long>(scans.size()) - used;
  if (moving > 0) tally["moving"] = moving;
  return groups;
}

/// Poses for groups that have no stops file: the log's odometry, or the origin for a single stop.
std::vector<Stop> own_stops(const Groups& groups, const std::vector<std::string>& labels,
                            const std::string& file) {
  std::vector<Stop> stops;
  for (std::size_t k = 0; k < groups.size(); ++k) {
    Stop stop;
    stop.label = labels.empty() ? std::to_string(k + 1) : labels[k];
    if (groups[k].front()->odometry) {
      stop.commanded = *groups[k].front()->odometry;
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

std::span<const Scan> scans_of(const std::vector<ScanLog>& logs, std::vector<Scan>& joined) {
  if (logs.size() == 1) return logs.front().scans;
  for (const ScanLog& log : logs) joined.insert(joined.end(), log.scans.begin(), log.scans.end());
  return joined;
}

StopSplit resolved_split(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops, StopSplit split) {
  if (split != StopSplit::automatic) return split;
  for (const ScanLog& log : logs)
    for (const Scan& scan : log.scans)
      if (!scan.stop.empty()) return StopSplit::label;
  return logs.size() > 1 && logs.size() == stops.size() ? StopSplit::file : StopSplit::standing;
}

std::vector<StopGroup> group_by_stop(const std::vector<ScanLog>& logs, const std::vector<Stop>& stops,
                                     const ScanNoise& noise, const ExtractOptions& options, StopSplit split,
                                     Tally& tally) {
  Groups groups;
  std::vector<std::string> labels;
  if (split == StopSplit::label) {
    groups = by_label(logs, labels, tally);
  } else if (split == StopSplit::file) {
    for (const ScanLog& log : logs) {
      groups.emplace_back();
      for (const Scan& scan : log.scans) groups.back().push_back(&scan);
    }
  } else if (split == StopSplit::scan) {
    for (const ScanLog& log : logs)
      for (const Scan& scan : log.scans) groups.push_back({&scan});
  } else {
    groups = by_standing(logs, noise, options.stand, tally);
  }
  const std::string& file = logs.front().path;
  if (groups.empty())
    throw InputError(
        file, 0, "",
        "no stop is found: the robot never stands for " + std::to_string(options.stand.scans_min) + " scans");
  for (const auto& group : groups) tally["used"] += static_cast<long>(group.size());

  std::vector<Stop> poses = stops;
  if (stops.empty()) {
    poses = own_stops(groups, labels, file);
  } else if (split == StopSplit::label) {
    poses.clear();
    for (std::size_t k = 0; k < groups.size(); ++k) {
      const auto same = [&](const Stop& stop) { return stop.label == labels[k]; };
      const auto found = std::find_if(stops.begin(), stops.end(), same);
      if (found == stops.end())
        throw InputError(file, groups[k].front()->row, "stop",
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
