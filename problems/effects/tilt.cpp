// SPDX-License-Identifier: BSD-3-Clause
// R12. The scan plane is tilted by tau about the level axis in direction b0: what it sees is stretched by
// 1 / cos tau across it.
//
//   delta d = 1/4 d (tau^2 - a cos 2b - c sin 2b)     [m]   = 1/2 tau^2 d sin^2(b - b0)
//   delta b = 1/4 (a sin 2b - c cos 2b)               [rad] = 1/4 tau^2 sin 2(b - b0)
//   a = tau^2 cos 2 b0, c = tau^2 sin 2 b0 [rad^2], tau^2 = hypot(a, c), b sensor direction [rad]
//
// The range part acts before the curve. Source: derived: a plane tilted by tau meets plumb landmarks stretched by 1 /
// cos tau; an affine stretch of the measured plane.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class Tilt final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "tilt",
        .number = "R12",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The scan plane is tilted: the picture is stretched across the tilt axis, in range and in "
            "bearing, twice per turn.",
        .formula =
            "delta d = 1/2 tau^2 d sin^2(b - b0) [m], delta b = 1/4 tau^2 sin 2(b - b0) [rad]; tau tilt, b0 "
            "its axis [rad]",
        .source = "derived: a plane tilted by tau meets plumb landmarks stretched by 1 / cos tau",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by =
            "turn the sensor at each stop (0, 90, 180, 270 degrees), or level the sensor with a spirit level",
        .parameters = {{.name = "cosine_rad2", .typical = 0.0076, .low = -0.5, .high = 0.5, .linear = false},
                       {.name = "sine_rad2", .typical = 0.0076, .low = -0.5, .high = 0.5, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    constexpr double start = 2.0 * degree;
    std::vector<Eigen::VectorXd> grid;
    grid.reserve(8);
    for (int i = 0; i < 8; ++i)
      grid.push_back(
          point({start * start * std::cos(45.0 * degree * i), start * start * std::sin(45.0 * degree * i)}));
    return grid;
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double c = std::cos(2.0 * at.bearing), s = std::sin(2.0 * at.bearing);
    return {.range = at.before_curve(0.25 * at.d * (std::hypot(p[0], p[1]) - p[0] * c - p[1] * s)),
            .bearing = 0.25 * (p[0] * s - p[1] * c)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"angle_rad", std::sqrt(std::hypot(p[0], p[1]))}, {"axis_rad", 0.5 * std::atan2(p[1], p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_tilt() { return std::make_unique<Tilt>(); }

}  // namespace rangecal::effects
