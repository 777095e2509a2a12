// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <initializer_list>
#include <limits>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/problems/effects/effect.hpp"

/// What several effects share: axes of start grids, and what a recording lacks, in words.
namespace rangecal::effects {

inline constexpr double degree = std::numbers::pi / 180.0;

/// A discrete parameter as the index that it stands for.
inline int index_of(double parameter) { return static_cast<int>(std::lround(parameter)); }

/// first, first + 1, ..., last; at most `most` of them, evenly thinned, ends kept. Empty if last < first.
inline std::vector<double> indices(int first, int last, int most = 1 << 20) {
  std::vector<double> values;
  const int count = last - first + 1, kept = std::min(count, most);
  values.reserve(std::max(kept, 0));
  for (int i = 0; i < kept; ++i)
    values.push_back(first +
                     (kept > 1 ? std::round(static_cast<double>(i) * (count - 1) / (kept - 1)) : 0.0));
  return values;
}

/// The parameter of an effect on one landmark: which one; and all that it can be.
inline EffectParameter which_landmark() {
  return {.name = "landmark", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true};
}
inline std::vector<double> every_landmark(const EffectContext& context) {
  return indices(0, context.landmark_count - 1);
}

/// The multiple of `step` next to a value; the value itself for no step.
inline double to_grid(double value, double step) {
  return step > 0.0 ? step * std::round(value / step) : value;
}

/// `count` values from low to high, equal steps.
inline std::vector<double> even_steps(double low, double high, int count) {
  std::vector<double> values;
  for (int i = 0; i < count; ++i) values.push_back(low + (high - low) * i / std::max(1, count - 1));
  return values;
}

/// `count` values from low to high > 0, equal ratios.
inline std::vector<double> even_ratios(double low, double high, int count) {
  std::vector<double> values = even_steps(std::log(low), std::log(high), count);
  for (double& value : values) value = std::exp(value);
  return values;
}

/// Wavenumbers from low to high such that the phase k * span between neighbours changes by `step` [rad] at
/// most, as far as `most` points allow.
inline std::vector<double> wavenumbers(double low, double high, double span, double step, int most) {
  const double wanted = std::ceil((high - low) * std::max(span, 0.0) / step) + 1.0;
  return even_steps(low, high, static_cast<int>(std::clamp(wanted, 2.0, static_cast<double>(most))));
}

/// One grid point.
inline Eigen::VectorXd point(std::initializer_list<double> values) {
  Eigen::VectorXd p(static_cast<Eigen::Index>(values.size()));
  std::copy(values.begin(), values.end(), p.data());
  return p;
}

inline std::string lacks_times(const EffectContext& context) {
  return context.duration_s > 0.0 ? "" : "times: a column time_s";
}

inline std::string lacks_landmarks(const EffectContext& context, int needed) {
  return context.landmark_count >= needed
             ? ""
             : "landmarks: readings of at least " + std::to_string(needed) + ", labelled";
}

/// Effects on poses or predicted bearings need stops.
inline std::string lacks_stops(const EffectContext& context, int needed) {
  if (context.kind == RecordingKind::pairs) return "stops: a recording of kind landmarks, pairs have none";
  return context.stop_count >= needed ? "" : "stops: at least " + std::to_string(needed);
}

/// Known distances that were read in one direction say nothing of what changes with it.
inline std::string lacks_directions(const EffectContext& context) {
  const bool one = context.kind == RecordingKind::pairs && context.largest_bearing_rad == 0.0;
  return one ? "directions: a column bearing_rad of known distances" : "";
}

inline std::string lacks_repeats(const EffectContext& context, int needed) {
  if (context.largest_cell >= needed) return "";
  return "repeats: at least " + std::to_string(needed) + " readings of each " +
         (context.kind == RecordingKind::pairs ? "distance" : "landmark at each stop");
}

inline std::string lacks_radii(const EffectContext& context) {
  const std::vector<double>& radii = context.landmark_radius_m;
  const bool round = std::any_of(radii.begin(), radii.end(), [](double radius) { return radius > 0.0; });
  return round ? "" : "radius_m of the landmarks";
}

/// Rot(heading) (forward, left): a vector of the robot's frame in the world's [m].
inline Eigen::Vector2d in_world(const Pose2& robot, double forward_m, double left_m) {
  const double c = std::cos(robot.heading_rad), s = std::sin(robot.heading_rad);
  return {c * forward_m - s * left_m, s * forward_m + c * left_m};
}

/// Turns a commanded path: headings by `scale` times `error` of each stop, 0 at the first of a recording, and each step by the
/// mean of the errors before and after it, as the chord of an arc.
inline void turn_path(double scale, const std::vector<double>& error, std::vector<StopPrior>& stops) {
  Pose2 commanded_before;
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const Pose2 commanded = stops[k].commanded;
    if (k > 0 && stops[k].recording == stops[k - 1].recording) {
      const double turn = scale * 0.5 * (error[k - 1] + error[k]);
      const double dx = commanded.x_m - commanded_before.x_m, dy = commanded.y_m - commanded_before.y_m;
      const Pose2& before = stops[k - 1].commanded;
      Pose2& pose = stops[k].commanded;
      pose.x_m = before.x_m + std::cos(turn) * dx - std::sin(turn) * dy;
      pose.y_m = before.y_m + std::sin(turn) * dx + std::cos(turn) * dy;
      pose.heading_rad += scale * error[k];
    }
    commanded_before = commanded;
  }
}

/// An effect along a covariate column, or the kind of them that stands in the catalogue, which changes nothing.
class ColumnEffect : public Effect {
 public:
  const EffectInfo& info() const final { return info_; }

  std::string missing(const EffectContext& context) const override {
    return index(context) < 0 ? lacking_ : "";
  }

 protected:
  /// `lacking`: what a recording without such a column lacks. Along a column id and covariate are the column's, and the
  /// physics names it.
  ColumnEffect(EffectInfo info, std::string lacking, const std::string& column)
      : info_(std::move(info)), column_(column), lacking_(std::move(lacking)) {
    if (column_.empty()) return;
    info_.id += ":" + column_;
    info_.covariate = column_;
    info_.physics = "Along " + column_ + ": " + info_.physics;
  }

  /// What the column holds beside a reading; NaN where it holds nothing.
  double value(const ReadingView<double>& at) const {
    const int column = at.context != nullptr && at.covariate != nullptr ? index(*at.context) : -1;
    return column < 0 ? std::numeric_limits<double>::quiet_NaN() : at.covariate[column];
  }

  /// Mean and standard deviation of the column over the recording; 0 and 1 where they are not known.
  ColumnSummary summary(const EffectContext& context) const {
    const int column = index(context);
    if (column < 0 || context.columns.empty()) return {ColumnRole::other, 0.0, 1.0};
    return context.columns[static_cast<std::size_t>(column)];
  }

 private:
  int index(const EffectContext& context) const {
    if (column_.empty()) return -1;
    const auto found = std::find(context.covariates.begin(), context.covariates.end(), column_);
    return found == context.covariates.end() ? -1 : static_cast<int>(found - context.covariates.begin());
  }

  EffectInfo info_;
  std::string column_, lacking_;
};

/// A number of an effect's formula that is read off the recording once and never moved.
inline EffectParameter given_by_column(const char* name, double low) {
  return {.name = name, .typical = 1.0, .low = low, .high = 1e9, .linear = false, .discrete = true};
}

/// The first of two complaints that says anything.
inline std::string either(std::string first, std::string second) {
  return first.empty() ? std::move(second) : std::move(first);
}

}  // namespace rangecal::effects
