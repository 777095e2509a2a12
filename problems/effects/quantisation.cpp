// SPDX-License-Identifier: BSD-3-Clause
// R7. Quantised centroid, or ranges written in whole millimetres.
//
//   steps of f^2 q and of u     [m]
//   variance  s^2 + (f^4 q^2 + u^2) / 12
//     q step of 1/r [1/m] (q = p q_px / (f s)), u least unit of the output [m]
//
// f the reading that the curve predicts. Adds to the log variance of range log(1 + (f^4 q^2 + u^2) / (12
// s^2)); the grid itself is read off the values. Source: derived: uniform rounding error.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class Quantisation final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "quantisation",
        .number = "R7",
        .kind = EffectKind::grid,
        .channel = "grid",
        .covariate = "range",
        .physics =
            "Ranges sit on a grid: the centroid is rounded to a fraction of a pixel (steps growing as d^2), "
            "or the output to a unit.",
        .formula =
            "steps f^2 q [m] and u [m], q step of 1/r [1/m], u output unit [m]; variance + (f^4 q^2 + u^2) / "
            "12",
        .source = "derived: uniform rounding error",
        .visible_by = "200 sweeps at one near, one middle and one far stop",
        .settled_by = "count the distinct values of 200 sweeps at one stop",
        .settled_of_pairs = {.changes = {"E7"}},
        .switched_off_by = {"finer readings"},
        .parameters = {
            {.name = "disparity_step_per_m", .typical = 0.001, .low = 0.0, .high = 0.05, .linear = false},
            {.name = "output_step_m", .typical = 0.001, .low = 0.0, .high = 0.05, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    std::vector<Eigen::VectorXd> grid;
    for (double step : even_ratios(5e-5, 0.02, 12)) grid.push_back(point({step, 0.0}));
    for (double step : {0.001, 0.002, 0.005, 0.01, 0.02}) grid.push_back(point({0.0, step}));
    return grid;
  }

  GridSteps grid_steps(const ReadingView<double>& at, const double* p) const override {
    return {.range_m = std::hypot(at.f * at.f * p[0], p[1])};
  }

  GridReading rounded(const GridReading& reading, const double* p) const override {
    double range = reading.range_m;
    if (p[0] > 0.0 && range > 0.0) range = 1.0 / to_grid(1.0 / range, p[0]);  // beyond 2 / q: none
    return {.range_m = to_grid(range, p[1]), .bearing_rad = reading.bearing_rad};
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double step = grid_steps(at, p).range_m;
    return {.range_log_variance = std::log1p(step * step / (12.0 * at.spread * at.spread))};
  }
};

}  // namespace

std::unique_ptr<Effect> make_quantisation() { return std::make_unique<Quantisation>(); }

}  // namespace rangecal::effects
