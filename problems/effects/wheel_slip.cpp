// SPDX-License-Identifier: BSD-3-Clause
// M6. One slip on the way: all stops from stop j on are moved along the step that led there.
//
//   s_k = c_k + delta u_j for k >= j,   u_j = (c_j - c_(j-1)) / |c_j - c_(j-1)|     [m]
//     delta way lost or won [m], c commanded positions; where stop j turns in place, u_j = (cos phi_j, sin phi_j), phi_j
//     its commanded heading
//
// A robot that turns when it has arrived has another heading than the step. Only within the recording of stop j. Source:
// derived: one step that is longer or shorter.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class WheelSlip final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "wheel_slip",
        .number = "M6",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "stop",
        .physics = "The wheels slipped once: all stops from one on are displaced along the way.",
        .formula =
            "s_k = c_k + delta u_j [m] for k >= j, u_j direction of the step from stop j - 1 to stop j",
        .source = "derived: one step that is longer or shorter",
        .visible_by = "stops before and after the slip",
        .settled_by = "drive the same stops again in reverse order",
        .parameters = {
            {.name = "distance_m", .typical = 0.05, .low = -10.0, .high = 10.0},
            {.name = "stop", .typical = 1.0, .low = 0.0, .high = 1e6, .linear = false, .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, indices(1, std::max(1, context.stop_count - 1))});
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 3); }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext&, const double* p, std::vector<StopPrior>& stops) const override {
    const auto from = static_cast<std::size_t>(index_of(p[1]));
    if (from >= stops.size()) return;
    const double heading = direction_to(from, stops), x = p[0] * std::cos(heading),
                 y = p[0] * std::sin(heading);
    for (std::size_t k = from; k < stops.size() && stops[k].recording == stops[from].recording; ++k) {
      stops[k].commanded.x_m += x;
      stops[k].commanded.y_m += y;
    }
  }

 private:
  /// Of the step to stop j [rad].
  static double direction_to(std::size_t j, const std::vector<StopPrior>& stops) {
    constexpr double in_place_m = 1e-3;
    if (j > 0 && stops[j - 1].recording == stops[j].recording) {
      const double x = stops[j].commanded.x_m - stops[j - 1].commanded.x_m,
                   y = stops[j].commanded.y_m - stops[j - 1].commanded.y_m;
      if (std::hypot(x, y) > in_place_m) return std::atan2(y, x);
    }
    return stops[j].commanded.heading_rad;
  }
};

}  // namespace

std::unique_ptr<Effect> make_wheel_slip() { return std::make_unique<WheelSlip>(); }

}  // namespace rangecal::effects
