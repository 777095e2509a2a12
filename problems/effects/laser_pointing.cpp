// SPDX-License-Identifier: BSD-3-Clause
// R4. Laser pointing or detector position off.
//
//   delta r = c d^2     [m]
//     c = delta psi / s = -delta x / (f s) [1/m]; delta psi laser angle [rad], s baseline [m]; delta x
//     shift of the detector, f s focal length times baseline
//
// Acts on the reading, after the curve: it is alpha_2. Source: derived from d = f s / x.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class LaserPointing final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "laser_pointing",
        .number = "R4",
        .kind = EffectKind::mean,
        .carrier = Carrier::light,
        .channel = "range",
        .covariate = "range",
        .physics =
            "The error of the range grows with its square: the laser points, or the detector sits, a little "
            "off.",
        .formula =
            "delta r = c d^2 [m], c = delta psi / s [1/m], delta psi laser angle [rad], s baseline [m]",
        .expression = "curvature*d^2",
        .source = "derived from d = f s / x",
        .visible_by = "nothing more than a curve of order 2: it is alpha_2",
        .settled_by = "not needed: alpha_2 takes it up; if it moves in time see warmup_drift",
        .parameters = {{.name = "curvature_per_m", .typical = 0.002, .low = -0.5, .high = 0.5}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = p[0] * at.d * at.d};
  }
};

}  // namespace

std::unique_ptr<Effect> make_laser_pointing() { return std::make_unique<LaserPointing>(); }

}  // namespace rangecal::effects
