// SPDX-License-Identifier: BSD-3-Clause
// R2. Which point of the arc is "the range": the nearest one, or the mean of the hits.
//
//   delta d = kappa R     [m]
//     R the radius of the landmark; kappa = 1 - pi/4 = 0.215 for the mean of all hits far away; 0 for the
//     nearest point
//
// Acts before the curve: delta r = f(d + kappa R) - f(d). Exact twin of radius_scale with kappa = -scale;
// of the change of kappa with distance (0.176 at D = 0.5 m, R = 0.12 m) the curve takes up what all landmarks share. Source: derived: mean depth
// R (1 - pi/4) of parallel beams on a circle.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class ArcDefinition final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "arc_definition",
        .number = "R2",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "radius",
        .physics =
            "The range is the mean over the hits on a landmark instead of its nearest point, so it grows "
            "with the radius: look at the code that extracts landmarks.",
        .formula =
            "delta d = kappa R [m] before the curve, R the radius [m]; mean of all hits: kappa = 1 - pi/4",
        .expression = "kappa*radius",
        .before_curve = true,
        .source = "derived: mean depth R (1 - pi/4) of parallel beams on a circle",
        .visible_by = "use landmarks of two or more radii (4 and 12 cm)",
        .settled_by = "read the extraction code, and use landmarks of two or more radii (4 and 12 cm)",
        .settled_of_pairs =
            {.otherwise = "read the extraction code, and use targets of two or more radii (4 and 12 cm)"},
        .exact_twins = {"radius_scale"},
        .parameters = {{.name = "kappa", .typical = 0.2, .low = -0.3, .high = 0.3}}};
    return value;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range = at.before_curve(p[0] * at.radius)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_arc_definition() { return std::make_unique<ArcDefinition>(); }

}  // namespace rangecal::effects
