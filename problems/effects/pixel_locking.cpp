// SPDX-License-Identifier: BSD-3-Clause
// R6. The sub-pixel peak finder is pulled towards pixel centres: periodic in the spot's place x = f s / d.
//
//   delta r = -A d^2 sum_n q^(n^2 - 1) / n sin(n (k / d + psi)),  n = 1, 2, ..., 5     [m]
//     k = 2 pi (f s / p) [m], f s focal length times baseline; p pixel pitch; A = hypot(c, s) = a p / (f s)
//     [1/m]; a [px] and psi [rad] amplitude and phase of the pull on the spot: c = -A sin psi, s = -A cos psi;
//     q = pi a = A k / 2, at most 1
//
// The first term is d^2 (c cos(k / d) + s sin(k / d)). A normal spot of standard deviation w pixels, summed over whole pixels, has
// its centroid at E[round(X)], X ~ N(x, w^2): by the Fourier series of X - round(X) it is off by
// sum_n (-1)^n q^(n^2) / (pi n) sin(2 pi n x) pixels with q = exp(-2 pi^2 w^2). A wide spot leaves the first term alone (q = 0.31 at
// 0.1 px: the second is 1.6 % of it), a point the sawtooth, whose first term is 1 / pi = 0.32 px.
//
// Acts on the reading, after the curve; d is where the spot stands for, with what effects on the path and the light add. A cover
// that lengthens the way of the light by 3 mm turns the pull at 0.6 m by a whole period. f s / p is 120 m for f s = 720 mm^2 and
// p = 6 um, 11 m for s = 55 mm and 5.1 mrad a pixel. Over the span W of 1/d the likelihood's peak in k is about 4 / W wide, so the
// grid steps by 2 / W: the phase between neighbours, relative to the middle, differs by 1 rad at the ends.
// Source: derived: the mean of a rounded normal variable; the effect: Shimizu and Okutomi 2002.
#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class PixelLocking final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "pixel_locking",
        .number = "R6",
        .kind = EffectKind::mean,
        .carrier = Carrier::light,
        .stage = Stage::spot,
        .channel = "range",
        .covariate = "disparity",
        .physics =
            "The range wobbles with a constant period in 1/d and an amplitude growing as d^2: the peak "
            "finder is pulled to pixel centres.",
        .formula =
            "delta r = -A d^2 sum_n q^(n^2 - 1) / n sin(n (k/d + psi)) = d^2 (c cos(k/d) + s sin(k/d)) + ... [m], n = "
            "1...5, k = 2 pi f s / p [m], p pixel pitch; A = a p / (f s) [1/m], a [px] and psi [rad] amplitude and "
            "phase of the pull on the spot; q = pi a, at most 1",
        .source = "derived: the mean of a rounded normal variable; the effect: Shimizu and Okutomi 2002",
        .visible_by = "ranges in steps under half a period (8 mm at 1 m, 75 mm at 3 m), seen against 1/d",
        .settled_by = "move one stop by 5 mm, five times",
        .settled_of_pairs = {.changes = {"E8"}},
        .parameters = {
            {.name = "cosine_per_m", .typical = 0.001, .low = -0.5, .high = 0.5},
            {.name = "sine_per_m", .typical = 0.001, .low = -0.5, .high = 0.5},
            {.name = "wavenumber_m", .typical = 750.0, .low = 20.0, .high = 2000.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const double near = std::max(context.range_min_m, 0.05), far = std::max(context.range_max_m, near);
    return grid_of({{0.0}, {0.0}, wavenumbers(50.0, 950.0, 1.0 / near - 1.0 / far, 2.0, 1200)});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double d = at.d + at.before_spot;
    const double phase = p[2] / d, cosine = std::cos(phase), sine = std::sin(phase);
    const double amplitude = std::hypot(p[0], p[1]), q = std::min(0.5 * amplitude * p[2], 1.0);
    // -A sin(n theta) by Chebyshev's recurrence, theta = k / d + psi; about an amplitude of 0 the first term is all.
    double before = 0.0, wave = p[0] * cosine + p[1] * sine, sum = wave;
    const double two_cos_theta = amplitude > 0.0 ? 2.0 * (p[0] * sine - p[1] * cosine) / amplitude : 0.0;
    const int terms = q < 1e-4 ? 1 : 5;  // the second is q^3 / 2 of the first, rounding
    double weight = 1.0, step = q;       // q^(n^2 - 1), and q^(2 n - 1) from n - 1 to n
    for (int n = 2; n <= terms; ++n) {
      before = std::exchange(wave, two_cos_theta * wave - before);
      step *= q * q;
      weight *= step;
      sum += weight / n * wave;
    }
    return {.range = d * d * sum};
  }

  /// Of no pull, where the first term is all.
  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override {
    if (parameter > 1 || p[0] != 0.0 || p[1] != 0.0) return std::nullopt;
    const double d = at.d + at.before_spot, phase = p[2] / d;
    return ReadingChange<double>{.range = d * d * (parameter == 0 ? std::cos(phase) : std::sin(phase))};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"amplitude_per_m", std::hypot(p[0], p[1])},
            {"phase_rad", std::atan2(-p[0], -p[1])},
            {"period_per_m", 2.0 * std::numbers::pi / p[2]}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_pixel_locking() { return std::make_unique<PixelLocking>(); }

}  // namespace rangecal::effects
