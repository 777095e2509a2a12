// SPDX-License-Identifier: BSD-3-Clause
// M5. The lidar does not sit at the robot's turning point.
//
//   s_k = c_k + Rot(phi_k) (q_x, q_y)     [m]
//     c_k commanded position, phi_k heading, q lidar in the robot frame
//
// At constant heading it shifts all stops alike: the landmarks take it up exactly. Source: derived: the lever turned by
// the heading, added to the stop.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class LeverArm final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "lever_arm",
        .number = "M5",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "heading",
        .physics = "The lidar sits beside the robot's turning point, so turning moves it.",
        .formula = "s_k = c_k + Rot(phi_k) q [m], q position of the lidar in the robot frame [m]",
        .source = "derived: the lever turned by the heading, added to the stop",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by =
            "turn the sensor at each stop (0, 90, 180, 270 degrees), or measure the lever with a ruler",
        .parameters = {{.name = "x_m", .typical = 0.02, .low = -5.0, .high = 5.0},
                       {.name = "y_m", .typical = 0.02, .low = -5.0, .high = 5.0}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 2); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    for (StopPrior& stop : stops) {
      const Eigen::Vector2d lever = in_world(stop.commanded, p[0], p[1]);
      stop.commanded.x_m += lever.x();
      stop.commanded.y_m += lever.y();
    }
  }
};

}  // namespace

std::unique_ptr<Effect> make_lever_arm() { return std::make_unique<LeverArm>(); }

}  // namespace rangecal::effects
