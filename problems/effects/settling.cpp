// SPDX-License-Identifier: BSD-3-Clause
// B7. The head still swings when the robot has stopped.
//
//   delta b = -A exp(-t / T)     [rad]
//     A yaw of the head at the stop's first reading [rad], t since the stop's first reading [s] (T in s), or
//     the number of the repeat where there are no times (T in repeats)
//
// T is at most the longest stay at a stop: what has not died away by its end does not settle there, it is a
// turned zero (bearing_offset).
//
// Source: derived: decay of an overdamped mount.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

/// The longest stay at a stop: in s, or in repeats without times; a second repeat's at least.
double stay_of(const EffectContext& context) {
  const double stay = context.stay_s > 0.0 ? context.stay_s : context.largest_cell - 1.0;
  return stay > 0.0 ? stay : 1.0;
}

class Settling final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "settling",
        .number = "B7",
        .kind = EffectKind::mean,
        .channel = "bearing",
        .covariate = "repeat",
        .physics = "The first sweeps after a stop are turned: the sensor still swings on its mount.",
        .formula =
            "delta b = -A exp(-t / T) [rad], A yaw of the head, t since the first reading of the stop [s], "
            "or repeats without "
            "times",
        .source = "derived: decay of an overdamped mount",
        .visible_by = "many sweeps at each stop",
        .settled_by = "wait longer before the first reading",
        .switched_off_by = {"E11"},
        .parameters = {{.name = "amplitude_rad", .typical = 0.01745, .low = -1.5, .high = 1.5},
                       {.name = "time_s", .typical = 1.0, .low = 1e-2, .high = 1e3, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const double stay = stay_of(context);
    return grid_of({{0.0}, even_ratios(std::min(0.15, 0.05 * stay), stay, 12)});
  }

  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    const auto [low, high] = Effect::bounds(context, parameter);
    if (parameter != 1) return {low, high};
    const double stay = stay_of(context);
    return {std::min(low, 0.05 * stay), std::min(high, stay)};
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 1), lacks_repeats(context, 3));
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const bool timed =
        at.context != nullptr && !at.context->stop_time_s.empty() && at.context->duration_s > 0.0;
    const double since =
        timed ? std::max(0.0, at.time_s - at.context->stop_time_s[static_cast<std::size_t>(at.stop)])
              : at.repeat;
    return {.bearing = -p[0] * std::exp(-since / p[1])};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    return {{"amplitude_rad", p[0]}, {context.stop_time_s.empty() ? "time_repeats" : "time_s", p[1]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_settling() { return std::make_unique<Settling>(); }

}  // namespace rangecal::effects
