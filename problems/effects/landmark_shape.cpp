// SPDX-License-Identifier: BSD-3-Clause
// R15. One landmark is out of round: semi-axes R (1 + eta) along psi and R (1 - eta) across.
//
//   delta d = -eta R cos 2(g - psi) = -R (e_c cos 2g + e_s sin 2g)     [m]
//     g = b + heading direction of view in the world [rad]; e_c = eta cos 2 psi, e_s = eta sin 2 psi
//
// Acts before the curve. A lean alone is below a millimetre and is not modelled. Source: derived: an ellipse, first
// order in eta.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class LandmarkShape final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "landmark_shape",
        .number = "R15",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "landmark",
        .physics =
            "One landmark is out of round: its range depends on the side from which it is seen, twice per "
            "turn.",
        .formula =
            "delta d = -eta R cos 2(g - psi) [m] before the curve, g direction of view in the world [rad], "
            "psi long axis [rad], R radius [m]",
        .source = "derived: an ellipse, first order in eta",
        .visible_by = "look at one landmark from many sides",
        .settled_by = "turn the landmark by 90 degrees and repeat",
        .parameters = {{.name = "cosine", .typical = 0.05, .low = -0.9, .high = 0.9},
                       {.name = "sine", .typical = 0.05, .low = -0.9, .high = 0.9},
                       which_landmark()}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, {0.0}, every_landmark(context)});
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 3), lacks_landmarks(context, 1));
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (at.landmark != index_of(p[2])) return {};
    const double twice = 2.0 * (at.bearing + at.heading);
    return {.range = at.before_curve(-at.radius * (p[0] * std::cos(twice) + p[1] * std::sin(twice)))};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"landmark", p[2]},
            {"out_of_round", std::hypot(p[0], p[1])},
            {"axis_rad", 0.5 * std::atan2(p[1], p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_landmark_shape() { return std::make_unique<LandmarkShape>(); }

}  // namespace rangecal::effects
