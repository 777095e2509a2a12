// SPDX-License-Identifier: BSD-3-Clause
// N5. Outliers everywhere: other lidars, specular hits.
//
//   (y - f) / s ~ Student-t with nu degrees of freedom     nu [-], ranges
//
// Source: physics catalogue N5.
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class HeavyTails final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "heavy_tails",
        .kind = EffectKind::tail,
        .channel = "range_tail",
        .covariate = "any",
        .physics =
            "A few readings miss by far, everywhere: another lidar, specular hits, or people walking by.",
        .formula = "residuals follow a Student-t with nu degrees of freedom",
        .source = "physics catalogue N5",
        .visible_by = "several hundred readings",
        .settled_by =
            "look where the outliers are: at edges, at one landmark, towards one device, everywhere",
        .parameters = {
            {.name = "degrees_of_freedom", .typical = 5.0, .low = 2.1, .high = 200.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{3.0, 5.0, 8.0}});
  }

  double degrees_of_freedom(const double* p) const override { return p[0]; }
};

}  // namespace

std::unique_ptr<Effect> make_heavy_tails() { return std::make_unique<HeavyTails>(); }

}  // namespace rangecal::effects
