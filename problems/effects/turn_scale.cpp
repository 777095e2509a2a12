// SPDX-License-Identifier: BSD-3-Clause
// M7. The robot turns by more, or less, than it means to: the distance between
// its wheels is not the one stated.
//
//   heading  phi_k = phi_k,commanded + eps a_k     [rad]
//   position  s_k = s_(k-1) + Rot(eps (a_(k-1) + a_k) / 2) (c_k - c_(k-1)) [m]
//     a_k sum of the commanded turns up to stop k, each in (-pi, pi] [rad]; c_k
//     commanded positions
//
// The error of a step's direction is the mean of those before and after it, as
// is that of the chord of an arc. eps = w_stated / w - 1 [-], w track. Source:
// derived: wheels at a wrong distance; UMBmark (Borenstein and Feng).
#include <cmath>

#include "rangecal/core/angles.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

/// Less than this much of turning in all is none [rad].
constexpr double least_turning = 10.0 * degree;

class TurnScale final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "turn_scale",
        .number = "M7",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "stop",
        .physics =
            "Every turn of the robot is larger or smaller than commanded by one factor: the distance between its "
            "wheels, the track, is not the one stated.",
        .formula =
            "phi_k += eps a_k [rad], a_k sum of the commanded turns up to stop k, steps turned by eps (a_(k-1) + "
            "a_k) / 2; eps = w_stated / w - 1, w track",
        .source = "derived: wheels at a wrong distance; UMBmark (Borenstein and Feng)",
        .visible_by = "several stops along a path with turns",
        .settled_by = "turn the robot ten times on the spot and measure by how much it misses",
        .parameters = {{.name = "scale", .typical = 0.03, .low = -0.5, .high = 0.5}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override {
    if (std::string lacking = lacks_stops(context, 3); !lacking.empty()) return lacking;
    double turning = 0.0;
    for (std::size_t k = 1; k < context.commanded.size(); ++k)
      turning += std::abs(turn(context.commanded[k - 1], context.commanded[k]));
    return turning > least_turning ? "" : "turns: a path on which the robot changes its heading";
  }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext& context, const double* p, std::vector<StopPrior>& stops) const override {
    if (context.commanded.size() != stops.size()) return;
    std::vector<double> turned;  // commanded, in its recording up to each stop
    for (std::size_t k = 0; k < stops.size(); ++k) {
      const bool first = k == 0 || stops[k].recording != stops[k - 1].recording;
      turned.push_back(first ? 0.0 : turned.back() + turn(context.commanded[k - 1], context.commanded[k]));
    }
    turn_path(p[0], turned, stops);
  }

 private:
  static double turn(const Pose2& before, const Pose2& after) {
    return wrap_angle(after.heading_rad - before.heading_rad);
  }
};

}  // namespace

std::unique_ptr<Effect> make_turn_scale() { return std::make_unique<TurnScale>(); }

}  // namespace rangecal::effects
