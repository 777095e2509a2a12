// SPDX-License-Identifier: BSD-3-Clause
// N5. Outliers everywhere: other lidars, specular hits.
//
//   (y - f) / s ~ (1 - pi) N(0, 1) + pi N(0, kappa^2)     pi share [-], kappa ratio of the spreads [-],
//   ranges
//
// Source: by definition: a share of the readings has a wider law.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class HeavyTails final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "heavy_tails",
        .number = "N5",
        .kind = EffectKind::tail,
        .channel = "range_tail",
        .covariate = "any",
        .physics =
            "A few readings miss by far, everywhere: another lidar, specular hits, or people walking by.",
        .formula =
            "a share pi of the readings has kappa times the spread: (1 - pi) N(0, s^2) + pi N(0, kappa^2 "
            "s^2)",
        .source = "by definition: a share of the readings has a wider law",
        .visible_by = "several hundred readings",
        .settled_by =
            "look where the outliers are: at edges, at one landmark, towards one device, everywhere",
        .settled_of_pairs =
            {.otherwise =
                 "look where the outliers are: at one distance, on one target, at one time, everywhere"},
        .parameters = {{.name = "share", .typical = 0.03, .low = 1e-4, .high = 0.4, .linear = false},
                       {.name = "ratio", .typical = 5.0, .low = 1.5, .high = 100.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.01, 0.03, 0.1}, {3.0, 6.0, 12.0}});
  }

  Contamination contamination(const ReadingView<double>& at, const double* p) const override {
    return {.share = p[0], .extra_sigma_m = at.spread * std::sqrt(p[1] * p[1] - 1.0)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_heavy_tails() { return std::make_unique<HeavyTails>(); }

}  // namespace rangecal::effects
