// SPDX-License-Identifier: BSD-3-Clause
// R12. The scan plane is tilted by tau about the level axis in direction b0: what it sees is stretched by
// 1 / cos tau across it.
//
//   delta d = d (sqrt(1 + tan^2 tau sin^2 u) - 1)          [m]   = 1/2 tau^2 d sin^2 u + ...
//   delta b = atan((k - 1) sin u cos u / (1 + (k - 1) sin^2 u)) [rad] = 1/4 tau^2 sin 2u + ...
//   u = b - b0, b sensor direction [rad], k = 1 / cos tau
//   a = tau^2 cos 2 b0, c = tau^2 sin 2 b0 [rad^2], tau^2 = hypot(a, c)
//
// The range part acts before the curve. Source: derived: a plane tilted by tau meets plumb landmarks stretched by 1 /
// cos tau; an affine stretch of the measured plane, (cos u, sin u) to (cos u, k sin u).
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
        .stage = Stage::path,
        .channel = "range",
        .covariate = "sensor_bearing",
        .physics =
            "The scan plane is tilted: the picture is stretched across the tilt axis, in range and in "
            "bearing, twice per turn.",
        .formula =
            "delta d = d (sqrt(1 + tan^2 tau sin^2 u) - 1) [m], delta b = atan((k - 1) sin u cos u / (1 + (k - "
            "1) sin^2 u)) [rad]; tau tilt, u direction from its axis [rad], k = 1 / cos tau",
        .source = "derived: a plane tilted by tau meets plumb landmarks stretched by 1 / cos tau",
        .visible_by = "turn the sensor at each stop (0, 90, 180, 270 degrees)",
        .settled_by =
            "turn the sensor at each stop (0, 90, 180, 270 degrees), or level the sensor with a spirit level",
        .settled_of_pairs = {.changes = {"E1"}},
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

  std::string missing(const EffectContext& context) const override { return lacks_directions(context); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double tau_sq = std::hypot(p[0], p[1]);
    if (!(tau_sq > 0.0)) return {};
    const double k = 1.0 / std::cos(std::sqrt(tau_sq));
    const double c = std::cos(2.0 * at.bearing), s = std::sin(2.0 * at.bearing);
    const double cos_2u = (p[0] * c + p[1] * s) / tau_sq, sin_2u = (p[0] * s - p[1] * c) / tau_sq;
    const double sin_sq = 0.5 * (1.0 - cos_2u);  // tan^2 tau = k^2 - 1
    return {.range = at.before_curve(at.d * (std::sqrt(1.0 + (k * k - 1.0) * sin_sq) - 1.0)),
            .bearing = std::atan2(0.5 * (k - 1.0) * sin_2u, 1.0 + (k - 1.0) * sin_sq)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"angle_rad", std::sqrt(std::hypot(p[0], p[1]))}, {"axis_rad", 0.5 * std::atan2(p[1], p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_tilt() { return std::make_unique<Tilt>(); }

}  // namespace rangecal::effects
