// SPDX-License-Identifier: BSD-3-Clause
// M8. The pose that stands beside a reading is that of another time: scan and odometry have clocks of their own, or were
// paired by their number.
//
//   of stops:            s_k, phi_k = path at t_k + tau     [m], [rad]
//   of known distances:  delta d = tau d'                   [m]
//     tau > 0: the reading was taken after the pose [s]; path through the commanded poses in time, its speed at each stop that
//     between the stops before and after it; d' rate of the true distance between the readings of one device before and after [m/s]
//
// To first order the place moves by v tau and the heading by omega tau. The part of known distances acts before the curve;
// `correct` takes the sensor for at rest. Source: derived: poses interpolated in time, by cubic Hermite splines (Catmull and
// Rom 1974).
#include <cmath>

#include "rangecal/core/angles.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

/// Stops of one recording: numbers [first, last).
struct Stretch {
  std::size_t first = 0, last = 0;
};

/// Times of a stretch of stops; of those that hold no reading, whose time is 0, in between those of the stops around them.
std::vector<double> times_of(const std::vector<double>& time_s, const Stretch& of) {
  std::vector<double> times(time_s.begin() + static_cast<std::ptrdiff_t>(of.first),
                            time_s.begin() + static_cast<std::ptrdiff_t>(of.last));
  std::size_t known = 0;
  for (std::size_t k = 1; k < times.size(); ++k) {
    if (!(times[k] > times[known])) continue;
    for (std::size_t i = known + 1; i < k; ++i)
      times[i] = times[known] +
                 (times[k] - times[known]) * static_cast<double>(i - known) / static_cast<double>(k - known);
    known = k;
  }
  for (std::size_t i = known + 1; i < times.size(); ++i) times[i] = times[known];
  return times;
}

/// A path in time through poses, headings unwrapped.
class TimedPath {
 public:
  /// Poses whose times do not ascend are left out.
  void add(double time_s, const Pose2& pose) {
    if (!times_s_.empty() && !(time_s > times_s_.back())) return;
    const double heading = points_.empty()
                               ? pose.heading_rad
                               : points_.back()[2] + wrap_angle(pose.heading_rad - points_.back()[2]);
    times_s_.push_back(time_s);
    points_.push_back({pose.x_m, pose.y_m, heading});
  }

  /// How far x, y and heading are at t + tau from where they are at t.
  Eigen::Vector3d way(double t, double tau) const {
    if (times_s_.size() < 2) return Eigen::Vector3d::Zero();
    return at(t + tau) - at(t);
  }

 private:
  /// Beyond its ends the path goes on straight.
  Eigen::Vector3d at(double t) const {
    const std::size_t after =
        static_cast<std::size_t>(std::upper_bound(times_s_.begin(), times_s_.end(), t) - times_s_.begin());
    if (after == 0) return points_.front() + (t - times_s_.front()) * speed(0);
    const std::size_t i = after - 1;
    const double h = after < times_s_.size() ? times_s_[after] - times_s_[i] : 0.0, u = t - times_s_[i];
    if (h == 0.0) return points_[i] + u * speed(i);
    const double x = u / h;
    const Eigen::Vector3d step = points_[after] - points_[i], from = h * speed(i), to = h * speed(after);
    return points_[i] + x * (from + x * (3.0 * step - 2.0 * from - to + x * (from + to - 2.0 * step)));
  }

  Eigen::Vector3d speed(std::size_t i) const {
    const std::size_t before = i > 0 ? i - 1 : 0, after = std::min(i + 1, times_s_.size() - 1);
    return (points_[after] - points_[before]) / (times_s_[after] - times_s_[before]);
  }

  std::vector<double> times_s_;
  std::vector<Eigen::Vector3d> points_;
};

class ScanLatency final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "scan_latency",
        .number = "M8",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "time",
        .physics =
            "The poses, or true distances, belong to another time than the readings: two clocks, or a delay "
            "between sensor and odometry.",
        .formula =
            "stops moved along the path by v tau [m] and turned by omega tau [rad]; known distances: delta d = "
            "tau dd/dt [m]; tau [s]",
        .source = "derived: poses interpolated in time, by cubic Hermite splines (Catmull and Rom 1974)",
        .visible_by = "read while driving, with changes of speed and direction, and record the time",
        .settled_by = "stand still longer before reading, or drive the same path backwards",
        .parameters = {{.name = "delay_s", .typical = 0.2, .low = -2.0, .high = 2.0, .linear = false}}};
    return value;
  }

  /// Of a path that bends, a fit from far away ends where it first bends back.
  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{-0.8, -0.5, -0.3, -0.1, 0.1, 0.3, 0.5, 0.8}});
  }

  std::string missing(const EffectContext& context) const override {
    const std::string at_rest = "motion: readings taken while the sensor moves";
    if (std::string lacking = lacks_times(context); !lacking.empty()) return lacking;
    if (context.kind == RecordingKind::pairs) return context.largest_rate_mps > 0.0 ? "" : at_rest;
    if (std::string lacking = lacks_stops(context, 4); !lacking.empty()) return lacking;
    // A robot that stays at its stops as long as it drives between them was at rest when it read.
    return context.stay_s < 0.5 * context.duration_s / context.stop_count ? "" : at_rest;
  }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext& context, const double* p, std::vector<StopPrior>& stops) const override {
    if (context.kind == RecordingKind::pairs || context.stop_time_s.size() != stops.size() ||
        context.commanded.size() != stops.size())
      return;
    for (Stretch of{0, 0}; of.first < stops.size(); of.first = of.last) {
      while (of.last < stops.size() && stops[of.last].recording == stops[of.first].recording) ++of.last;
      const std::vector<double> times = times_of(context.stop_time_s, of);
      TimedPath path;
      for (std::size_t k = of.first; k < of.last; ++k) path.add(times[k - of.first], context.commanded[k]);
      for (std::size_t k = of.first; k < of.last; ++k) {
        const Eigen::Vector3d way = path.way(times[k - of.first], p[0]);
        Pose2& pose = stops[k].commanded;
        const double turned = pose.heading_rad - context.commanded[k].heading_rad;  // by other effects
        pose.x_m += std::cos(turned) * way[0] - std::sin(turned) * way[1];
        pose.y_m += std::sin(turned) * way[0] + std::cos(turned) * way[1];
        pose.heading_rad += way[2];
      }
    }
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = at.rate_mps == 0.0 ? 0.0 : at.before_curve(p[0] * at.rate_mps)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_scan_latency() { return std::make_unique<ScanLatency>(); }

}  // namespace rangecal::effects
