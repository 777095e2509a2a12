// SPDX-License-Identifier: BSD-3-Clause
// N8. Some readings are too far: the beam misses part of the target and meets what stands behind it, or comes back over
// a second surface.
//
//   with share p:  y = f + s N(0, 1) + x,   x ~ Exp of mean tau
//     p share [-], tau mean excess [m], ranges
//
// Source: by definition; exponentially modified Gaussian (Grushka 1972). That the excess is exponential is assumed.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class LateReturn final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "late_return",
        .number = "N8",
        .kind = EffectKind::tail,
        .channel = "range_tail",
        .covariate = "any",
        .physics =
            "Some readings are too far: the beam met what stands behind the target, or came back over a "
            "second surface.",
        .formula = "a share p of the readings is x further, x exponential of mean tau [m]",
        .source = "by definition; exponentially modified Gaussian (Grushka 1972)",
        .visible_by = "several hundred readings",
        .settled_by = "clear or cover the background behind the targets, and record again",
        .parameters = {{.name = "share", .typical = 0.05, .low = 1e-4, .high = 0.6, .linear = false},
                       {.name = "excess_m", .typical = 0.3, .low = 0.01, .high = 20.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.01, 0.04, 0.15}, {0.05, 0.3, 1.5}});
  }

  Contamination contamination(const ReadingView<double>&, const double* p) const override {
    return {.share = p[0], .mean_m = p[1]};
  }
};

}  // namespace

std::unique_ptr<Effect> make_late_return() { return std::make_unique<LateReturn>(); }

}  // namespace rangecal::effects
