// SPDX-License-Identifier: BSD-3-Clause
// N1. The ranges have a second source of noise, which grows with distance by another power than the fitted one.
//
//   s^2 -> s^2 (1 + r (f / f0)^q)
//     f reading [m], f0 geometric middle of the ranges [m], r ratio of the variances there [-], q difference of their
//     powers of f [-]
//
// Beside a fitted s = sigma f^2 (speckle, or pixels of one size): q = -4 a floor, q = 2 photons' shot noise (s ~ f^3),
// q = 4 background or read noise (s ~ f^4). A law that takes the place of the fitted one altogether is r >> 1; the level
// is in the fitted law. Source: derived: variances of independent sources add: floor, speckle d^2, shot d^3, background d^4;
// Dorsch, Haeusler and Herrmann 1994.
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class NoiseLaw final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "noise_law",
        .number = "N1",
        .kind = EffectKind::noise,
        .channel = "range_noise",
        .covariate = "range",
        .physics =
            "The spread grows with distance by another law than the one fitted: beside it there is a floor, photon "
            "or background noise.",
        .formula =
            "s^2 -> s^2 (1 + r (f / f0)^q), f0 geometric middle of the ranges [m]; r ratio of the variances there, q "
            "difference of their powers of f: beside s ~ f^2 -4 a floor, 2 shot noise, 4 background",
        .source =
            "derived: variances of independent sources add: floor, speckle d^2, shot d^3, background d^4; Dorsch, "
            "Haeusler and Herrmann 1994",
        .visible_by = "repeats at four or more well-spread ranges",
        .settled_by = "200 sweeps at one near, one middle and one far stop; record intensity as a column",
        .settled_of_pairs = {.changes = {"E7"}},
        .parameters = {{.name = "ratio", .typical = 1.0, .low = 0.0, .high = 1000.0},
                       {.name = "power", .typical = 4.0, .low = -8.0, .high = 8.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0}, {-6.0, -4.0, -2.0, 2.0, 4.0, 6.0}});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    return {.range_log_variance = std::log1p(p[0] * std::pow(relative_range(at), p[1]))};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int index) const override {
    const double x = relative_range(at), power = std::pow(x, p[1]), by_power = p[0] * std::log(x);
    return ReadingChange<double>{.range_log_variance =
                                     (index == 0 ? 1.0 : by_power) * power / (1.0 + p[0] * power)};
  }

  /// How much wider the readings scatter at either end of the ranges: ratio and power say that only together.
  std::vector<std::pair<std::string, double>> reported(const EffectContext& context,
                                                       const double* p) const override {
    const auto factor = [&](double f) {
      return std::sqrt(1.0 + p[0] * std::pow(f / middle_of(&context), p[1]));
    };
    return {{"power", p[1]},
            {"spread_factor_near", factor(std::max(context.range_min_m, 1e-3))},
            {"spread_factor_far", factor(std::max(context.range_max_m, 1e-3))}};
  }

 private:
  static double middle_of(const EffectContext* context) {
    return context != nullptr && context->range_min_m > 0.0
               ? std::sqrt(context->range_min_m * context->range_max_m)
               : 1.0;
  }
  static double relative_range(const ReadingView<double>& at) {
    return std::max(at.f, 1e-3) / middle_of(at.context);
  }
};

}  // namespace

std::unique_ptr<Effect> make_noise_law() { return std::make_unique<NoiseLaw>(); }

}  // namespace rangecal::effects
