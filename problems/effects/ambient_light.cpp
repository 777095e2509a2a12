// SPDX-License-Identifier: BSD-3-Clause
// R10. Ambient or stray light in a sector of directions.
//
//   |b - b_c| < w:   delta r = c d^2 [m],   log s^2 -> log s^2 + v
//     b direction in the sensor frame [rad], b_c centre and w half-width of the sector [rad], c [1/m]
//
// c = -(B / (S + B)) (x_win - x) / (f s): the background pulls the centroid to the middle x_win of its
// window; v >= 0. Acts on the reading, after the curve. Source: derived: centroid of signal and background in one
// window.
#include <cmath>
#include <numbers>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class AmbientLight final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "ambient_light",
        .number = "R10",
        .kind = EffectKind::noise,
        .carrier = Carrier::light,
        .channel = "range_noise",
        .covariate = "sensor_bearing",
        .physics =
            "Readings in one sector of directions scatter more, and shift: ambient light, or light of its "
            "own behind the window.",
        .formula =
            "within half-width w of b_c [rad]: log variance + v, delta r = c d^2 [m], c = -(B / (S + B)) "
            "(x_win - x) / (f s) [1/m]",
        .source = "derived: centroid of signal and background in one window",
        .visible_by = "landmarks all around the sensor",
        .settled_by = "switch the lights off, or cover the window, and repeat",
        .settled_of_pairs = {.changes = {"E10"}},
        .switched_off_by = {"E10"},
        .parameters = {{.name = "log_variance", .typical = 1.2, .low = 0.0, .high = 12.0},
                       {.name = "curvature_per_m", .typical = 0.0005, .low = -1.0, .high = 1.0},
                       {.name = "direction_rad",
                        .typical = 1.0,
                        .low = -3.2,
                        .high = 3.2,
                        .linear = false,
                        .discrete = true},
                       {.name = "half_width_rad",
                        .typical = 0.5,
                        .low = 0.0,
                        .high = 3.2,
                        .linear = false,
                        .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0},
                    {0.0},
                    even_steps(-180.0 * degree, 160.0 * degree, 18),
                    {15.0 * degree, 30.0 * degree, 60.0 * degree}});
  }

  std::string missing(const EffectContext& context) const override { return lacks_directions(context); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (std::abs(std::remainder(at.bearing - p[2], 2.0 * std::numbers::pi)) > p[3]) return {};
    return {.range = p[1] * at.d * at.d, .range_log_variance = p[0]};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"direction_rad", p[2]},
            {"half_width_rad", p[3]},
            {"spread_factor", std::exp(0.5 * p[0])},
            {"curvature_per_m", p[1]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_ambient_light() { return std::make_unique<AmbientLight>(); }

}  // namespace rangecal::effects
