// SPDX-License-Identifier: BSD-3-Clause
// R8. Below a distance the firmware works differently: peak window, exposure or power switch.
//
//   delta r = (c + g (d - d_s)) for d < d_s, else 0     [m]
//     d_s switching distance [m], c step [m], g change of slope [-]
//
// Acts on the reading, after the curve. Source: step and slope below a distance, their sizes unpublished; firmware that
// halves its window near the array end: iliasam/OpenSimpleLidar.
#include <algorithm>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class NearRegime final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "near_regime",
        .number = "R8",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "range",
        .physics =
            "Ranges below one distance follow another curve: the firmware switches its peak window, exposure "
            "or power there.",
        .formula =
            "delta r = c + g (d - d_s) [m] for d < d_s [m], 0 beyond; c step [m], g change of slope [-]",
        .source =
            "step and slope below a distance, their sizes unpublished; firmware that halves its window near the "
            "array end: iliasam/OpenSimpleLidar",
        .visible_by = "dense ranges across the switching distance",
        .settled_by = "place landmarks at 0.3-0.6 m and at the far end; record the device's flag as a column",
        .settled_of_pairs = {.changes = {"E9", "denser"},
                             .otherwise = "record the device's flag as a column"},
        .parameters = {{.name = "offset_m", .typical = 0.005, .low = -1.0, .high = 1.0},
                       {.name = "slope", .typical = 0.01, .low = -0.9, .high = 0.9},
                       {.name = "limit_m",
                        .typical = 1.0,
                        .low = 0.0,
                        .high = 100.0,
                        .linear = false,
                        .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const double near = context.range_min_m, span = std::max(context.range_max_m - near, 0.0);
    return grid_of({{0.0}, {0.0}, even_steps(near + 0.03 * span, near + 0.6 * span, 80)});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (!(at.d < p[2])) return {};
    return {.range = p[0] + p[1] * (at.d - p[2])};
  }

  double switching_distance(const double* p) const override { return p[2]; }
};

}  // namespace

std::unique_ptr<Effect> make_near_regime() { return std::make_unique<NearRegime>(); }

}  // namespace rangecal::effects
