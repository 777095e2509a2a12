// SPDX-License-Identifier: BSD-3-Clause
// M4. Slip accumulates: the error of a stop adds to that of the stop before.
//
//   s_k = s_(k-1) + (c_k - c_(k-1)) + e_k,   e_k ~ N(0, sigma^2 I)     [m]
//     variance k sigma^2 after k steps
//
// Replaces the independent errors of all stops but the first of a recording; a stop that stays at the
// place of the one before has no error of its own. Headings keep what is stated of them: errors of their own, or,
// in a recording that is a random walk already, errors that add up. Source: derived: the errors of the steps add up.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class OdometryRandomWalk final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "odometry_random_walk",
        .number = "M4",
        .kind = EffectKind::dependence,
        .channel = "stop",
        .covariate = "stop",
        .physics = "The errors of the stops accumulate along the path: slip adds up from step to step.",
        .formula = "s_k = s_(k-1) + (c_k - c_(k-1)) + e_k, e_k ~ N(0, sigma^2) per coordinate [m]",
        .source = "derived: the errors of the steps add up",
        .visible_by = "many stops",
        .settled_by = "record a second driving speed; drive a closed loop back to the first stop",
        .parameters = {{.name = "step_m", .typical = 0.01, .low = 1e-4, .high = 0.3, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.002, 0.005, 0.01, 0.02, 0.05}});
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 4); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    for (std::size_t k = 1; k < stops.size(); ++k) {
      if (stops[k].recording != stops[k - 1].recording || !stops[k].opens_place) continue;
      if (!stops[k].chained) stops[k].turns_add_up = false;
      stops[k].chained = true;
      stops[k].sigma_xy_m = p[0];
      stops[k].shape.reset();
    }
  }
};

}  // namespace

std::unique_ptr<Effect> make_odometry_random_walk() { return std::make_unique<OdometryRandomWalk>(); }

}  // namespace rangecal::effects
