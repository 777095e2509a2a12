// SPDX-License-Identifier: BSD-3-Clause
// N3. An error shared by all readings of a stop: it stands elsewhere than stated, or is turned.
//
//   sigma_xy -> hypot(sigma_xy, sigma_p),   sigma_heading -> hypot(sigma_heading, sigma_phi)     [m], [rad]
//
// Acts on the priors of the stops. Where sigma_xy is 0 the position stays exact; a covariance of a stop's own
// keeps its shape in the plane. Stated spreads that are off by a factor: stated_sigma. Source: derived: an error of the
// stop, seen along each direction.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

/// The turn that is added to a heading's error is its own: its covariance with the position stays what it
/// was.
void thin_correlation(double factor, StopPrior& stop) {
  Eigen::Matrix3d Q = *stop.shape;
  Q.topRightCorner<2, 1>() *= factor;
  Q.bottomLeftCorner<1, 2>() *= factor;
  stop.shape = std::make_shared<const Eigen::Matrix3d>(Q);
}

class StopEffect final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "stop_effect",
        .number = "N3",
        .kind = EffectKind::dependence,
        .channel = "stop",
        .covariate = "stop",
        .physics = "The stops scatter more than stated: all landmarks of a stop share an error.",
        .formula = "sqrt(sigma_xy^2 + sigma_p^2) [m], sqrt(sigma_heading^2 + sigma_phi^2) [rad] per stop",
        .source = "derived: an error of the stop, seen along each direction",
        .visible_by = "several landmarks at each stop",
        .settled_by = "mark the stops on the floor, or state sigma_xy_m and sigma_heading_rad as they are",
        .parameters = {
            {.name = "position_sigma_m", .typical = 0.01, .low = 0.0, .high = 1.0, .linear = false},
            {.name = "heading_sigma_rad", .typical = 0.00524, .low = 0.0, .high = 0.0873, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return {point({0.01, 0.0}),   point({0.03, 0.0}),   point({0.0, 0.005}),
            point({0.0, 0.0175}), point({0.01, 0.005}), point({0.03, 0.0175})};
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 4); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    for (StopPrior& stop : stops) {
      if (stop.sigma_xy_m > 0.0) stop.sigma_xy_m = std::hypot(stop.sigma_xy_m, p[0]);
      const double before = stop.sigma_heading_rad;
      stop.sigma_heading_rad = std::hypot(before, p[1]);
      if (stop.shape && stop.sigma_heading_rad > before)
        thin_correlation(before / stop.sigma_heading_rad, stop);
    }
  }
};

}  // namespace

std::unique_ptr<Effect> make_stop_effect() { return std::make_unique<StopEffect>(); }

}  // namespace rangecal::effects
