// SPDX-License-Identifier: BSD-3-Clause
// M1. Wheel radius wrong: the path is longer or shorter than commanded by one factor.
//
//   s_k = s_0 + (1 + eps) (c_k - c_0)     [m]
//     c_k commanded position of stop k, c_0 of the recording's first, eps [-]
//
// Source: derived: all steps by one factor; UMBmark (Borenstein and Feng).
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class OdometryScale final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "odometry_scale",
        .number = "M1",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "stop",
        .physics =
            "The robot drives farther or less far than commanded by one factor: the wheel radius is wrong.",
        .formula =
            "s_k = s_0 + (1 + eps)(c_k - c_0) [m], c commanded positions, eps relative error of the path "
            "length",
        .source = "derived: all steps by one factor; UMBmark (Borenstein and Feng)",
        .visible_by = "tape one distance between two landmarks",
        .settled_by = "tape one distance between two landmarks",
        .parameters = {{.name = "scale", .typical = 0.01, .low = -0.9, .high = 0.9}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 2); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    std::size_t first = 0;
    Pose2 start;
    for (std::size_t k = 0; k < stops.size(); ++k) {
      if (k == 0 || stops[k].recording != stops[first].recording) start = stops[first = k].commanded;
      Pose2& pose = stops[k].commanded;
      pose.x_m += p[0] * (pose.x_m - start.x_m);
      pose.y_m += p[0] * (pose.y_m - start.y_m);
    }
  }
};

}  // namespace

std::unique_ptr<Effect> make_odometry_scale() { return std::make_unique<OdometryScale>(); }

}  // namespace rangecal::effects
