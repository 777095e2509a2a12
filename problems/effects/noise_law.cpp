// SPDX-License-Identifier: BSD-3-Clause
// N1. The ranges have further sources of noise, which grow with distance by other powers than the fitted one.
//
//   s^2 -> s^2 (1 + n (f / f_near)^-q + m (f / f_far)^q),   n = e^u - 1, m = e^v - 1
//     f reading [m], f_near and f_far the nearest and farthest of the recording [m]; n, m ratios of the variances there
//     [-] of a source that matters near and of one that matters far, u and v what they add to ln s^2 there;
//     q difference of the powers of f [-]
//
// Beside a fitted s = sigma f^2 (speckle, or pixels of one size): q = 4 a floor near, and background or read noise far
// (s ~ f^4); q = 2 photons' shot noise far (s ~ f^3). A law that takes the place of the fitted one altogether is n or
// m >> 1; the level is in the fitted law. Source: derived: variances of independent sources add: floor, speckle d^2,
// shot d^3, background d^4; Dorsch, Haeusler and Herrmann 1994.
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
            "s^2 -> s^2 (1 + (e^u - 1) (f / f_near)^-q + (e^v - 1) (f / f_far)^q), f_near, f_far ends of the ranges [m]; u, v "
            "added to ln s^2 there; beside s ~ f^2 a floor is u with q = 4, shot noise v with q = 2, background v with q = 4",
        .source =
            "derived: variances of independent sources add: floor, speckle d^2, shot d^3, background d^4; Dorsch, "
            "Haeusler and Herrmann 1994",
        .visible_by = "repeats at four or more well-spread ranges",
        .settled_by = "200 sweeps at one near, one middle and one far stop; record intensity as a column",
        .settled_of_pairs = {.changes = {"E7"}},
        .parameters = {{.name = "log_variance_near", .typical = 1.2, .low = 0.0, .high = 12.0},
                       {.name = "log_variance_far", .typical = 1.2, .low = 0.0, .high = 12.0},
                       {.name = "power", .typical = 4.0, .low = 1.0, .high = 8.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0}, {0.0}, {2.0, 4.0, 6.0}});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const auto [near, far] = growth(logarithms(at), p[2]);
    return {.range_log_variance = std::log1p(std::expm1(p[0]) * near + std::expm1(p[1]) * far)};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int index) const override {
    const auto logs = logarithms(at);
    const auto [near, far] = growth(logs, p[2]);
    const double n = std::expm1(p[0]), m = std::expm1(p[1]);
    const double slopes[] = {(1.0 + n) * near, (1.0 + m) * far,
                             m * far * logs.second - n * near * logs.first};
    return ReadingChange<double>{.range_log_variance = slopes[index] / (1.0 + n * near + m * far)};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"spread_factor_near", std::exp(0.5 * p[0])},
            {"spread_factor_far", std::exp(0.5 * p[1])},
            {"power", p[2]}};
  }

 private:
  /// log(f / f_near) and log(f / f_far).
  static std::pair<double, double> logarithms(const ReadingView<double>& at) {
    const double f = std::max(at.f, 1e-3);
    if (at.context == nullptr || !(at.context->range_min_m > 0.0)) return {std::log(f), std::log(f)};
    return {std::log(f / at.context->range_min_m), std::log(f / at.context->range_max_m)};
  }
  /// (f / f_near)^-q and (f / f_far)^q.
  static std::pair<double, double> growth(const std::pair<double, double>& logs, double power) {
    return {std::exp(-power * logs.first), std::exp(power * logs.second)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_noise_law() { return std::make_unique<NoiseLaw>(); }

}  // namespace rangecal::effects
