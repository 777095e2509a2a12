// SPDX-License-Identifier: BSD-3-Clause
// W3. Weak returns drop out: readings beyond a limit are not there, so that those left are too short on
// average.
//
//   z = (c - f) / s,  lambda = phi(z) / Phi(z)
//   delta r = -s lambda [m],   variance  s^2 (1 - z lambda - lambda^2)
//     c limit of the reading [m], f predicted reading [m], s its spread [m]; phi and Phi density and
//     distribution of the standard normal
//
// Mean and variance of the normal truncated from above, so that the Gaussian likelihood serves. Source: derived:
// moments of the truncated normal, inverse Mills ratio.
#include <cmath>
#include <numbers>

#include "rangecal/core/distributions.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class Dropout final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "dropout",
        .number = "W3",
        .kind = EffectKind::detection,
        .channel = "detection",
        .covariate = "range",
        .physics =
            "Far readings are missing beyond a limit, and those left near it are too short on average.",
        .formula =
            "delta r = -s phi(z) / Phi(z) [m], z = (c - f) / s; c limit of the reading [m], f its prediction "
            "[m], s its spread [m]",
        .source = "derived: moments of the truncated normal, inverse Mills ratio",
        .visible_by = "landmarks at the far end of the range",
        .settled_by = "count missing readings against distance and landmark; place landmarks at the far end",
        .settled_of_pairs = {.changes = {"farther"},
                             .otherwise = "count missing readings against distance and target"},
        .parameters = {{.name = "limit_m", .typical = 4.0, .low = 0.0, .high = 100.0, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({even_steps(0.4 * context.range_max_m, 1.2 * context.range_max_m, 33)});
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double z = (p[0] - at.f) / at.spread;
    if (z > 8.0) return {};
    if (z < -20.0)  // lambda = -z - 1/z + ...: the mean is the limit, the variance (s / z)^2
      return {.range = p[0] - at.f + at.spread / z, .range_log_variance = -2.0 * std::log(-z)};
    const double density = std::exp(-0.5 * z * z) * std::numbers::inv_sqrtpi / std::numbers::sqrt2;
    const double mills = density / normal_below(z);
    return {.range = -at.spread * mills, .range_log_variance = std::log1p(-mills * (z + mills))};
  }
};

}  // namespace

std::unique_ptr<Effect> make_dropout() { return std::make_unique<Dropout>(); }

}  // namespace rangecal::effects
