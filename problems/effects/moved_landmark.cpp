// SPDX-License-Identifier: BSD-3-Clause
// W1. A landmark was moved or pushed during the recording, between two stops.
//
//   from stop j on, landmark l:   delta d = |d n + delta| - d [m],   delta b = atan(t . delta / (D + n . delta)) [rad]
//   n = (cos g, sin g), t = (-sin g, cos g), g = b + heading direction of the landmark in the world,
//       delta [m], D axis distance [m]
//
// The range part acts before the curve, and the spread goes along. Linear in delta to first order in delta / D; of the second
// order of the range the part R / D is left out, R radius [m], so that `correct` needs no radius. Source: derived: a step of the
// landmark.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class MovedLandmark final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "moved_landmark",
        .number = "W1",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "landmark",
        .physics = "One landmark was moved during the recording: from one stop on it stands elsewhere.",
        .formula =
            "from stop j on, landmark l: delta d = |d n + delta| - d [m], delta b = atan(t . delta / (D + n . "
            "delta)) [rad], D distance to its axis, n unit vector to it, t across, delta [m]",
        .source = "derived: a step of the landmark",
        .visible_by = "each landmark seen before and after",
        .settled_by = "drive the same stops again in reverse order",
        .parameters = {
            {.name = "x_m", .typical = 0.02, .low = -10.0, .high = 10.0},
            {.name = "y_m", .typical = 0.02, .low = -10.0, .high = 10.0},
            which_landmark(),
            {.name = "stop", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of(
        {{0.0}, {0.0}, every_landmark(context), indices(1, std::max(1, context.stop_count - 1), 40)});
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 3), lacks_landmarks(context, 2));
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (at.landmark != index_of(p[2]) || at.stop < index_of(p[3])) return {};
    const double direction = at.bearing + at.heading, c = std::cos(direction), s = std::sin(direction);
    const double along = c * p[0] + s * p[1], across = c * p[1] - s * p[0];
    const double change = at.before_curve(std::hypot(at.d + along, across) - at.d);
    return {.range = change,
            .bearing = std::atan2(across, at.axis_distance + along),
            .range_log_variance = at.spread_along(change)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    std::vector<std::pair<std::string, double>> values{{"landmark", p[2]},
                                                       {"from_stop", p[3]},
                                                       {"x_m", p[0]},
                                                       {"y_m", p[1]},
                                                       {"distance_m", std::hypot(p[0], p[1])}};
    const auto stop = static_cast<std::size_t>(index_of(p[3]));
    if (stop < context.stop_time_s.size()) values.emplace_back("from_time_s", context.stop_time_s[stop]);
    return values;
  }
};

}  // namespace

std::unique_ptr<Effect> make_moved_landmark() { return std::make_unique<MovedLandmark>(); }

}  // namespace rangecal::effects
