// SPDX-License-Identifier: BSD-3-Clause
// C1. The sensor reports depth along its optical axis, not distance: a camera that ranges a target of known size.
//
//   A target of height H at depth z = d cos(b - b0) along the axis is imaged at height h = F H / z (F focal length), so
//   ranging by h gives z. With a share kappa of that left uncorrected the curve sees d (1 - kappa (1 - cos(b - b0))):
//   d' = d - kappa d (1 - cos(b - b0))     [m], b direction in the sensor frame, b0 that of the axis [rad]
//   delta r = f(d') - f(d)                 [m]
//   log s^2 -> log s^2 + 2 p log(f(d') / f(d)), p of the noise law s = sigma f^p
//
// Acts on d, before the curve, so the spread goes along: at 60 degrees off the axis it is that of half the distance.
// kappa = 1: depth itself; kappa = 0: distance. Only for sensors that look one way.
// Source: derived: pinhole projection of a target of known size; found on the camera recordings of docs/real-data.md.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class AxialDepth final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "axial_depth",
        .number = "C1",
        .kind = EffectKind::mean,
        .carrier = Carrier::light,
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The sensor reports depth along its optical axis instead of distance: divide readings by the cosine of "
            "the direction.",
        .formula =
            "d' = d - kappa d (1 - cos(b - b0)) [m], kappa share left uncorrected, b0 axis [rad]: delta r = "
            "f(d') - f(d) [m], log variance + 2 p log(f(d') / f(d)), p of the noise law",
        .expression = "-kappa*d*(1 - cos(b - axis))",
        .before_curve = true,
        .source = "derived: pinhole projection of a target of known size",
        .visible_by = "targets at one distance, from the middle to the edge of the field of view",
        .settled_by = "turn the sensor so that one target crosses the field of view at a fixed distance",
        .parameters = {{.name = "kappa", .typical = 1.0, .low = -1.0, .high = 3.0},
                       {.name = "axis_rad", .typical = 0.05, .low = -0.4, .high = 0.4, .linear = false}}};
    return value;
  }

  std::string missing(const EffectContext& context) const override {
    constexpr double widest = 1.2;  // rad: wider than any lens that images depth
    return context.largest_bearing_rad < widest
               ? ""
               : "a sensor that looks one way: readings come from all around";
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0}, {-0.1, 0.0, 0.1}});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double change = at.before_curve(-p[0] * at.d * (1.0 - std::cos(at.bearing - p[1])));
    return {.range = change, .range_log_variance = at.spread_along(change)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_axial_depth() { return std::make_unique<AxialDepth>(); }

}  // namespace rangecal::effects
