// SPDX-License-Identifier: BSD-3-Clause
// R18. All radii are wrong by one factor: R_true = (1 + eps) R.
//
//   delta d = -eps R     [m], R the stated radius
//
// Acts before the curve: delta r = f(d - eps R) - f(d). Exact twin of arc_definition. Source: derived: d = D - R, twin
// of arc_definition.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class RadiusScale final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "radius_scale",
        .number = "R18",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "radius",
        .physics =
            "All radii are wrong by one factor, circumference taken for diameter or paper thickness ignored, "
            "say.",
        .formula = "delta d = -eps R [m] before the curve, R the stated radius [m], eps the relative error",
        .expression = "-scale*radius",
        .before_curve = true,
        .source = "derived: d = D - R, twin of arc_definition",
        .visible_by = "use landmarks of two or more radii (4 and 12 cm)",
        .settled_by =
            "measure the landmarks with a calliper, and use landmarks of two or more radii (4 and 12 cm)",
        .settled_of_pairs =
            {.otherwise =
                 "measure the targets with a calliper, and use targets of two or more radii (4 and 12 cm)"},
        .exact_twins = {"arc_definition"},
        .parameters = {{.name = "scale", .typical = 0.05, .low = -0.9, .high = 0.9}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = at.before_curve(-p[0] * at.radius)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_radius_scale() { return std::make_unique<RadiusScale>(); }

}  // namespace rangecal::effects
