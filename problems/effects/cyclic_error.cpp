// SPDX-License-Identifier: BSD-3-Clause
// R16. Cyclic error of a phase-measuring sensor: a leaking signal adds to the modulation.
//
//   delta r = A sin(k d + psi) = c cos(k d) + s sin(k d)     [m]
//     k = 2 pi / Lambda [rad/m], Lambda 0.05 ... 2 m, half the modulation wavelength; c = A sin psi, s = A cos psi
//
// Acts on the reading, after the curve; d is the light's way, with what effects on the path add. The grid steps k by 1 rad over
// the span of d. Source: Lichti and Licht 2006 (cyclic terms of surveying scanners).
#include <cmath>
#include <numbers>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class CyclicError final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "cyclic_error",
        .number = "R16",
        .kind = EffectKind::mean,
        .stage = Stage::light,
        .channel = "range",
        .covariate = "range",
        .physics =
            "The range wobbles with a constant period in d: crosstalk in the phase measurement of a "
            "modulated laser.",
        .formula =
            "delta r = A sin(2 pi d / Lambda + psi) = c cos(k d) + s sin(k d) [m], k = 2 pi / Lambda [rad/m], "
            "psi phase at d = 0 [rad]",
        .expression = "cosine*cos(wavenumber*d) + sine*sin(wavenumber*d)",
        .source = "Lichti and Licht 2006 (cyclic terms of surveying scanners)",
        .visible_by = "ranges in steps under a quarter of the wavelength",
        .settled_by = "move one stop by small steps along the line of sight",
        .settled_of_pairs = {.otherwise = "move the target by small steps along the line of sight"},
        .parameters = {
            {.name = "cosine_m", .typical = 0.005, .low = -10.0, .high = 10.0},
            {.name = "sine_m", .typical = 0.005, .low = -10.0, .high = 10.0},
            {.name = "wavenumber_per_m", .typical = 10.0, .low = 2.0, .high = 140.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    constexpr double turn = 2.0 * std::numbers::pi;
    const double span = context.range_max_m - context.range_min_m;
    return grid_of({{0.0}, {0.0}, wavenumbers(turn / 2.0, turn / 0.05, span, 1.0, 400)});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double phase = p[2] * (at.d + at.before_light);
    return {.range = p[0] * std::cos(phase) + p[1] * std::sin(phase)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"amplitude_m", std::hypot(p[0], p[1])},
            {"phase_rad", std::atan2(p[0], p[1])},
            {"wavelength_m", 2.0 * std::numbers::pi / p[2]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_cyclic_error() { return std::make_unique<CyclicError>(); }

}  // namespace rangecal::effects
