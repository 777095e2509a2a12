// SPDX-License-Identifier: BSD-3-Clause
// N7. Some readings are too near: dust or fog before the target, a sound that came by a side lobe, the floor, the device's
// own cover.
//
//   with share p:  y = f + s N(0, 1) - x,   x of density ~ exp(-x / tau) between 0 and f
//     p share [-], tau reach [m], ranges; a reach far above f: even between sensor and target
//
// Source: by definition; short readings of the beam model of Thrun, Burgard, Fox 2005, section 6.3. There their density
// falls from the sensor on; here from the target, or not at all.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class EarlyEcho final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "early_echo",
        .number = "N7",
        .kind = EffectKind::tail,
        .channel = "range_tail",
        .covariate = "any",
        .physics =
            "Some readings are too near: something before the target sent the beam back, as dust, the floor or "
            "a side lobe do.",
        .formula =
            "a share p of the readings is x nearer, x of density exp(-x / tau) up to f(d) [m]; tau far above "
            "f(d): even between sensor and target",
        .source = "by definition; short readings of the beam model of Thrun, Burgard, Fox 2005, section 6.3",
        .visible_by = "several hundred readings",
        .settled_by = "clear what is between sensor and targets, and record again",
        .parameters = {{.name = "share", .typical = 0.05, .low = 1e-4, .high = 0.6, .linear = false},
                       {.name = "reach_m", .typical = 0.3, .low = 0.01, .high = 20.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.01, 0.04, 0.15}, {0.05, 0.3, 5.0}});
  }

  Contamination contamination(const ReadingView<double>& at, const double* p) const override {
    return {.share = p[0], .mean_m = -p[1], .end_m = std::fmax(at.f, 1e-3)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_early_echo() { return std::make_unique<EarlyEcho>(); }

}  // namespace rangecal::effects
