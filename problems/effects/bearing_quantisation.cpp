// SPDX-License-Identifier: BSD-3-Clause
// B5. Beams lie on a grid, and the bearing is the middle between first and last hit: it lies on a grid, too.
//
//   variance  Delta^2 / 12     [rad^2], Delta step of the values: the beams' spacing or half of it
//     shared by the repeats of a (stop, landmark) where the noise is less than half a step: it does not average out
//
// Source: derived: variance of a uniform rounding error.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class BearingQuantisation final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "bearing_quantisation",
        .number = "B5",
        .kind = EffectKind::grid,
        .channel = "grid",
        .covariate = "sensor_bearing",
        .physics = "Bearings sit on the grid of the beams: they repeat within a stop and do not average out.",
        .formula =
            "variance + Delta^2 / 12 [rad^2], shared by repeats whose noise is below Delta / 2, Delta step "
            "of the values [rad]",
        .source = "derived: variance of a uniform rounding error",
        .visible_by = "several sweeps at each stop",
        .settled_by =
            "rotate the sensor by a fraction of the beam spacing and repeat, or use larger landmarks",
        .parameters = {
            {.name = "step_rad", .typical = 0.01745, .low = 0.0, .high = 0.0873, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.25 * degree, 0.5 * degree, 0.72 * degree, 1.0 * degree, 2.0 * degree}});
  }

  std::string missing(const EffectContext& context) const override {
    return either(lacks_stops(context, 1), lacks_repeats(context, 2));
  }

  GridSteps grid_steps(const ReadingView<double>&, const double* p) const override {
    return {.bearing_rad = p[0]};
  }

  GridReading rounded(const GridReading& reading, const double* p) const override {
    return {.range_m = reading.range_m, .bearing_rad = to_grid(reading.bearing_rad, p[0])};
  }

  Dependence dependence(const double* p) const override {
    return {.bearing_cell_sigma_rad = p[0] / std::sqrt(12.0)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_bearing_quantisation() { return std::make_unique<BearingQuantisation>(); }

}  // namespace rangecal::effects
