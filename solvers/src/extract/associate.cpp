// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <cmath>
#include <set>
#include <string_view>
#include <utility>

#include "extract/association_parts.hpp"

namespace rangecal {
namespace {

using namespace extract;

constexpr int kPasses = 6;
constexpr double kMapSd = 0.01;  ///< of a position in a given map [m]
constexpr double kLandmarkFloor =
    0.02;  ///< sightings of one landmark share errors: its position is never better [m]

/// All sightings by stop, and what a pass over the stops makes of them.
class Associator {
 public:
  Associator(std::span<const Pose2> commanded, std::span<const Sighting> sightings,
             const AssociationOptions& options)
      : commanded_(commanded), sightings_(sightings), options_(options), by_stop_(commanded.size()) {
    for (std::size_t i = 0; i < sightings.size(); ++i)
      by_stop_[static_cast<std::size_t>(sightings[i].stop)].push_back(i);
    bend_.slack_m = options.range_slack_m, bend_.slack = options.range_slack;
    for (const Eigen::Vector2d& position : options.map)
      map_.push_back({position, kMapSd * kMapSd * Eigen::Matrix2d::Identity()});
  }

  Association run() {
    std::vector<int> before;
    for (int pass = 0; pass < kPasses; ++pass) {
      sweep();
      if (options_.map.empty()) {
        average_landmarks();
        merge_landmarks();
      }
      if (pass > 0 && out_.landmark == before) break;
      before = out_.landmark;
      bend_ranges();
    }
    if (options_.map.empty()) drop_rare();
    for (const MapLandmark& landmark : map_) out_.landmarks.push_back(landmark.position);
    return std::move(out_);
  }

 private:
  StopView view_of(std::size_t stop) const {
    StopView view;
    for (const std::size_t i : by_stop_[stop]) {
      view.measured.push_back(bend_.measured(sightings_[i], options_.bearing_offset_rad));
      view.noise.push_back(bend_.covariance(sightings_[i], options_.bearing_slack_rad));
    }
    return view;
  }

  /// Matches every stop in turn; unknown sightings become landmarks where there is no map.
  void sweep() {
    out_ = {};
    out_.landmark.assign(sightings_.size(), -1);
    out_.reason.assign(sightings_.size(), "");
    beliefs_.clear();
    for (std::size_t stop = 0; stop < commanded_.size(); ++stop) {
      const PoseBelief prior = predicted(stop == 0 ? nullptr : &beliefs_.back(),
                                         commanded_[stop == 0 ? 0 : stop - 1], commanded_[stop], options_);
      const StopView view = view_of(stop);
      const StopMatch match = match_stop(prior, view, map_, options_);
      beliefs_.push_back(match.belief);
      out_.stops.push_back(match.belief.pose);
      for (std::size_t q = 0; q < match.pairs.size(); ++q) {
        const std::size_t i = by_stop_[stop][q];
        out_.landmark[i] = match.pairs[q];
        out_.reason[i] = match.reason[q];
        out_.cost += match.distance[q];
        out_.matched += match.pairs[q] >= 0;
        const bool is_new = match.pairs[q] < 0 && std::string_view(match.reason[q]) == "matches no landmark";
        if (!is_new || !options_.map.empty()) continue;
        out_.landmark[i] = static_cast<int>(map_.size());
        map_.push_back(found_landmark(match.belief, view.measured[q], view.noise[q]));
      }
    }
  }

  /// Landmarks where all their sightings put them, weighted; those without a sighting go.
  void average_landmarks() {
    std::vector<Eigen::Matrix2d> information(map_.size(), Eigen::Matrix2d::Zero());
    std::vector<Eigen::Vector2d> moment(map_.size(), Eigen::Vector2d::Zero());
    for (std::size_t i = 0; i < sightings_.size(); ++i) {
      if (out_.landmark[i] < 0) continue;
      const MapLandmark one = found_landmark(beliefs_[static_cast<std::size_t>(sightings_[i].stop)],
                                             bend_.measured(sightings_[i], options_.bearing_offset_rad),
                                             bend_.covariance(sightings_[i], options_.bearing_slack_rad));
      const auto j = static_cast<std::size_t>(out_.landmark[i]);
      const Eigen::Matrix2d weight = one.covariance.inverse();
      information[j] += weight, moment[j] += weight * one.position;
    }
    std::vector<int> renamed(map_.size(), -1);
    Map kept;
    for (std::size_t j = 0; j < map_.size(); ++j) {
      if (information[j].isZero(0.0)) continue;
      renamed[j] = static_cast<int>(kept.size());
      const Eigen::Matrix2d covariance = information[j].inverse();
      kept.push_back({covariance * moment[j],
                      covariance + kLandmarkFloor * kLandmarkFloor * Eigen::Matrix2d::Identity()});
    }
    rename(renamed, std::move(kept));
  }

  /// Joins landmarks that lie within each other's uncertainty and were never seen from the same stop.
  void merge_landmarks() {
    std::vector<std::set<int>> seen_from(map_.size());
    for (std::size_t i = 0; i < sightings_.size(); ++i)
      if (out_.landmark[i] >= 0)
        seen_from[static_cast<std::size_t>(out_.landmark[i])].insert(sightings_[i].stop);
    std::vector<int> renamed(map_.size());
    Map kept;
    std::vector<std::set<int>> kept_from;
    for (std::size_t j = 0; j < map_.size(); ++j) {
      int home = -1;
      for (std::size_t k = 0; k < kept.size() && home < 0; ++k) {
        const Eigen::Vector2d off = map_[j].position - kept[k].position;
        const double distance = off.dot((map_[j].covariance + kept[k].covariance).ldlt().solve(off));
        const bool together = std::any_of(seen_from[j].begin(), seen_from[j].end(),
                                          [&](int stop) { return kept_from[k].count(stop) > 0; });
        if (distance < options_.gate && !together) home = static_cast<int>(k);
      }
      if (home < 0) {
        home = static_cast<int>(kept.size());
        kept.push_back(map_[j]), kept_from.emplace_back();
      }
      kept_from[static_cast<std::size_t>(home)].insert(seen_from[j].begin(), seen_from[j].end());
      renamed[j] = home;
    }
    rename(renamed, std::move(kept));
  }

  void rename(const std::vector<int>& renamed, Map kept) {
    for (int& landmark : out_.landmark)
      if (landmark >= 0) landmark = renamed[static_cast<std::size_t>(landmark)];
    map_ = std::move(kept);
  }

  /// The quadratic that brings the raw distances to those of the map, and what is left, as the new slack.
  void bend_ranges() {
    Eigen::Matrix3d information =
        Eigen::Vector3d(1e2, 1e2, 1e2).asDiagonal();  // shifts near 0 where little is seen
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    std::vector<std::pair<Eigen::Vector3d, double>> rows;
    for (std::size_t i = 0; i < sightings_.size(); ++i) {
      if (out_.landmark[i] < 0) continue;
      const Pose2& stop = out_.stops[static_cast<std::size_t>(sightings_[i].stop)];
      const Eigen::Vector2d& landmark = map_[static_cast<std::size_t>(out_.landmark[i])].position;
      const double r = sightings_[i].axis_m;
      rows.emplace_back(Eigen::Vector3d(1.0, r, r * r),
                        std::hypot(landmark.x() - stop.x_m, landmark.y() - stop.y_m) - r);
    }
    if (rows.size() < 20) return;
    for (const auto& [row, off] : rows) {
      information += row * row.transpose() / (0.05 * 0.05);
      right += off * row / (0.05 * 0.05);
    }
    const Eigen::Vector3d shift = information.ldlt().solve(right);
    double squares = 0.0;
    for (const auto& [row, off] : rows) squares += std::pow(off - row.dot(shift), 2);
    bend_.shift = {shift(0), shift(1), shift(2)};
    bend_.slack_m = std::max(0.02, 2.0 * std::sqrt(squares / static_cast<double>(rows.size())));
    bend_.slack = 0.2 * options_.range_slack;
  }

  /// Landmarks seen from too few stops are no landmarks.
  void drop_rare() {
    std::vector<std::set<int>> seen_from(map_.size());
    for (std::size_t i = 0; i < sightings_.size(); ++i)
      if (out_.landmark[i] >= 0)
        seen_from[static_cast<std::size_t>(out_.landmark[i])].insert(sightings_[i].stop);
    const std::size_t least =
        std::min<std::size_t>(static_cast<std::size_t>(options_.stops_min), commanded_.size());
    for (std::size_t i = 0; i < sightings_.size(); ++i)
      if (out_.landmark[i] >= 0 && seen_from[static_cast<std::size_t>(out_.landmark[i])].size() < least)
        out_.reason[i] = "landmark seen from too few stops";
    std::vector<int> renamed(map_.size(), -1);
    Map kept;
    for (std::size_t j = 0; j < map_.size(); ++j) {
      if (seen_from[j].size() < least) continue;
      renamed[j] = static_cast<int>(kept.size());
      kept.push_back(map_[j]);
    }
    rename(renamed, std::move(kept));
    for (std::size_t i = 0; i < sightings_.size(); ++i)
      if (out_.landmark[i] >= 0) out_.reason[i] = "";
    out_.matched = static_cast<int>(
        std::count_if(out_.landmark.begin(), out_.landmark.end(), [](int l) { return l >= 0; }));
  }

  std::span<const Pose2> commanded_;
  std::span<const Sighting> sightings_;
  const AssociationOptions& options_;
  std::vector<std::vector<std::size_t>> by_stop_;
  Map map_;
  RangeBend bend_;
  std::vector<PoseBelief> beliefs_;
  Association out_;
};

}  // namespace

Association associate(std::span<const Pose2> commanded, std::span<const Sighting> sightings,
                      const AssociationOptions& options) {
  return Associator(commanded, sightings, options).run();
}

}  // namespace rangecal
