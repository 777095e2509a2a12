// SPDX-License-Identifier: BSD-3-Clause
// R5. Lens distortion beyond what offset, scale and pointing take up.
//
//   delta r = k / d     [m], k [m^2] = -1e-6 k1 (f s)^2, k1 radial distortion [1/mm^2], f s focal length times
//                       baseline [mm^2]
//
// Acts on the reading, after the curve. Source: derived: x (1 + k1 x^2) with x = f s / d.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class LensDistortion final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "lens_distortion",
        .number = "R5",
        .kind = EffectKind::mean,
        .carrier = Carrier::light,
        .channel = "range",
        .covariate = "disparity",
        .physics =
            "Near ranges bend away from the curve like 1/d: lens distortion where the spot sits at the edge "
            "of the lens.",
        .formula =
            "delta r = k / d [m], k [m^2] = -1e-6 k1 (f s)^2, k1 radial distortion [1/mm^2], f s in mm^2",
        .expression = "inverse/d",
        .source = "derived: x (1 + k1 x^2) with x = f s / d",
        .visible_by = "ranges under 0.5 m together with far ones",
        .settled_by = "place landmarks at 0.3-0.6 m and at the far end",
        .settled_of_pairs = {.changes = {"E9", "farther"}, .otherwise = "read more often near the sensor"},
        .parameters = {{.name = "inverse_m2", .typical = 0.002, .low = -0.5, .high = 0.5}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = p[0] / at.d};
  }
};

}  // namespace

std::unique_ptr<Effect> make_lens_distortion() { return std::make_unique<LensDistortion>(); }

}  // namespace rangecal::effects
