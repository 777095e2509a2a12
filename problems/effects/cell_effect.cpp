// SPDX-License-Identifier: BSD-3-Clause
// N2. A part of the error repeats at one (stop, landmark): texture, speckle, locking.
//
//   y = f(d) + u_kl + e,   u_kl ~ N(0, sigma^2)     [m], shared by all repeats of stop k and landmark l
//
// Source: derived: one error shared by all repeats of a cell.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class CellEffect final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "cell_effect",
        .number = "N2",
        .kind = EffectKind::dependence,
        .channel = "range_dependence",
        .covariate = "any",
        .physics =
            "Readings repeat better than they are right: a part of the error is shared by all repeats at a "
            "stop.",
        .formula = "y = f(d) + u + e, u ~ N(0, sigma^2) [m] shared by all repeats of a (stop, landmark)",
        .source = "derived: one error shared by all repeats of a cell",
        .visible_by = "several sweeps at each stop",
        .settled_by = "move one stop by 5 mm, five times",
        .settled_of_pairs = {.changes = {"E8"}},
        .parameters = {{.name = "sigma_m", .typical = 0.005, .low = 0.0, .high = 1.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0005, 0.001, 0.002, 0.005, 0.01, 0.02}});
  }

  std::string missing(const EffectContext& context) const override { return lacks_repeats(context, 2); }

  Dependence dependence(const double* p) const override { return {.range_cell_sigma_m = p[0]}; }
};

}  // namespace

std::unique_ptr<Effect> make_cell_effect() { return std::make_unique<CellEffect>(); }

}  // namespace rangecal::effects
