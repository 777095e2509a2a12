// SPDX-License-Identifier: BSD-3-Clause
// R13. Warm-up: mount and laser pointing move towards their warm state.
//
//   delta r = (c0 + c2 d^2) (1 - exp(-t / T))     [m]
//     c0 [m], c2 [1/m], t time since the first reading [s], T [s]
//
// Acts on the reading, after the curve. Source: derived: range_offset and laser_pointing relaxing exponentially;
// warm-up advice: Toelgyessy et al. 2021.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class WarmupDrift final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "warmup_drift",
        .number = "R13",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "time",
        .physics = "The range creeps in the course of the recording and levels off: the sensor warms up.",
        .formula =
            "delta r = (c0 + c2 d^2)(1 - exp(-t / T)) [m], c0 [m], c2 [1/m], t since the first reading [s], "
            "T time constant [s]",
        .expression = "(offset + curvature*d^2)*(1 - exp(-t/time))",
        .source =
            "derived: range_offset and laser_pointing relaxing exponentially; warm-up advice: Toelgyessy et al. 2021",
        .visible_by = "drive the same stops again in reverse order",
        .settled_by = "leave the sensor on for 45 minutes, then repeat the first stop",
        .settled_of_pairs = {.changes = {"cold start", "E12"}},
        .parameters = {{.name = "offset_m", .typical = 0.01, .low = -10.0, .high = 10.0},
                       {.name = "curvature_per_m", .typical = 0.0025, .low = -1.0, .high = 1.0},
                       {.name = "time_s", .typical = 600.0, .low = 1e-3, .high = 1e6, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const double run = context.duration_s > 0.0 ? context.duration_s : 1.0;
    return grid_of({{0.0}, {0.0}, even_ratios(0.05 * run, 3.0 * run, 12)});
  }

  std::string missing(const EffectContext& context) const override { return lacks_times(context); }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = (p[0] + p[1] * at.d * at.d) * (1.0 - std::exp(-at.time_s / p[2]))};
  }
};

}  // namespace

std::unique_ptr<Effect> make_warmup_drift() { return std::make_unique<WarmupDrift>(); }

}  // namespace rangecal::effects
