// SPDX-License-Identifier: BSD-3-Clause
// N9. The spread of the stops' places is stated wrong: smaller or larger than it is by one factor.
//
//   sigma_xy -> k sigma_xy,   k = exp(g)     [m]
//
// Acts on the priors of the stops; what is exact stays so, and headings scatter as stated. An error that adds to the one
// stated: stop_effect. Source: derived: the variance of the stops' errors against the one stated.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class StatedSigma final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "stated_sigma",
        .number = "N9",
        .kind = EffectKind::dependence,
        .channel = "stop",
        .covariate = "stop",
        .physics = "The stops scatter more, or less, than stated by one factor: sigma_xy_m was guessed.",
        .formula = "sigma_xy exp(g) [m] per stop",
        .source = "derived: the variance of the stops' errors against the one stated",
        .visible_by = "several landmarks at each stop",
        .settled_by = "mark the stops on the floor and measure how far the robot misses them",
        .parameters = {{.name = "log_factor", .typical = 0.7, .low = -4.0, .high = 4.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return {point({0.7}), point({-0.7}), point({1.4}), point({-1.4})};
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 4); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    for (StopPrior& stop : stops) stop.sigma_xy_m *= std::exp(p[0]);
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"factor", std::exp(p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_stated_sigma() { return std::make_unique<StatedSigma>(); }

}  // namespace rangecal::effects
