// SPDX-License-Identifier: BSD-3-Clause
// M2. Unequal wheels: the robot turns by kappa per metre driven while it means to go straight.
//
//   heading  phi_k = phi_k,commanded + kappa l_k     [rad]
//   position  p_k = p_(k-1) + Rot(kappa (l_(k-1) + l_k) / 2) (c_k - c_(k-1))     [m]
//             s_k = p_k + (Rot(phi_k) - Rot(phi_0)) (0, -kappa w^2 / 4)     [m]
//     l_k path length driven [m]; c_k commanded positions; w track, the distance of the wheels [m]
//
// Turning on the spot the wheels run equally far, to either side: unequal ones turn the robot about the point kappa w^2 / 4 to its left, so
// that turns move it as a lever would. A recording whose headings are all the same says nothing of w.
//
// A gyro that creeps evenly does the same to a robot that drives evenly. The chord of an arc has its mean direction; a lateral
// shift of kappa l^2 / 2 on a straight line. kappa = (E_d - 1) / w [1/m], E_d ratio of the wheels' diameters.
// Source: derived: wheels of unequal diameter; UMBmark (Borenstein and Feng).
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class PathCurvature final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "path_curvature",
        .number = "M2",
        .kind = EffectKind::mean,
        .channel = "stop",
        .covariate = "stop",
        .physics =
            "The straight path is an arc: one wheel is larger than the other, or the gyro that holds the course creeps.",
        .formula =
            "phi_k += kappa l_k [rad], steps turned by kappa (l_(k-1) + l_k) / 2, turns about (0, kappa w^2 / 4); "
            "kappa = (E_d - 1) / w [1/m], l path length [m], w track [m]",
        .source = "derived: wheels of unequal diameter; UMBmark (Borenstein and Feng)",
        .visible_by = "several stops along a path",
        .settled_by =
            "drive the same path forwards and backwards; at half the speed a gyro that creeps bends it twice as much, "
            "wheels as before",
        .parameters = {{.name = "curvature_per_m", .typical = 0.02, .low = -3.0, .high = 3.0},
                       {.name = "track_m", .typical = 0.35, .low = 0.0, .high = 1.0, .linear = false}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override { return lacks_stops(context, 3); }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, {turns(context) ? info().parameters[1].typical : 0.0}});
  }

  std::pair<double, double> bounds(const EffectContext& context, std::size_t parameter) const override {
    return parameter == 1 && !turns(context) ? std::pair(0.0, 0.0) : Effect::bounds(context, parameter);
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    if (turns(context)) return Effect::reported(context, p);
    return {{info().parameters[0].name, p[0]}};
  }

  bool acts_on_stops() const override { return true; }

  void stops(const EffectContext& context, const double* p, std::vector<StopPrior>& stops) const override {
    if (context.path_m.size() != stops.size()) return;
    std::vector<double> path_m;  // of its recording, up to each stop
    double start_m = 0.0;
    for (std::size_t k = 0; k < stops.size(); ++k) {
      if (k == 0 || stops[k].recording != stops[k - 1].recording) start_m = context.path_m[k];
      path_m.push_back(context.path_m[k] - start_m);
    }
    turn_path(p[0], path_m, stops);
    const double left_m = p[0] * p[1] * p[1] / 4.0;  // of the robot: the point about which it turns
    Eigen::Vector2d right_at_first;                  // of a recording
    for (std::size_t k = 0; k < stops.size(); ++k) {
      Pose2& pose = stops[k].commanded;
      const Eigen::Vector2d right = in_world(pose, 0.0, -1.0);
      if (k == 0 || stops[k].recording != stops[k - 1].recording) right_at_first = right;
      pose.x_m += left_m * (right.x() - right_at_first.x());
      pose.y_m += left_m * (right.y() - right_at_first.y());
    }
  }

 private:
  /// False where the headings say nothing of the track.
  static bool turns(const EffectContext& context) {
    constexpr double next_to_none = 0.1;  // rad
    return context.headings > next_to_none;
  }
};

}  // namespace

std::unique_ptr<Effect> make_path_curvature() { return std::make_unique<PathCurvature>(); }

}  // namespace rangecal::effects
