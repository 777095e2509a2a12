// SPDX-License-Identifier: BSD-3-Clause
// R3. Baseline or focal length off; with a temperature column also their thermal expansion.
//
//   delta r = eps d                                      [m], form 0
//   delta r = eps (T - 20 C) / (10 K) d                  [m], form 1: expansion c_T = eps / (10 K)
//
// Acts on the reading, after the curve: form 0 is alpha_1. Form 1 needs the column temperature_c; an empty
// field counts as 20 C. Source: derived from d = f s / x.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class RangeScale final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "range_scale",
        .number = "R3",
        .kind = EffectKind::mean,
        .channel = "range",
        .covariate = "range",
        .physics =
            "All ranges are wrong by one factor: baseline or focal length differ from what the firmware "
            "believes, or grow with temperature.",
        .formula = "delta r = eps d [m]; with temperature eps = c_T (T - 20 C), c_T [1/K]",
        .source = "derived from d = f s / x",
        .visible_by = "tape one distance between two landmarks",
        .settled_by = "tape one distance between two landmarks, or the length of the path",
        .settled_of_pairs =
            {.otherwise =
                 "check the known distances against another tape; where the temperature changes, record it as a column temperature_c"},
        .parameters = {
            {.name = "scale", .typical = 0.0015, .low = -0.9, .high = 0.9},
            {.name = "form", .typical = 1.0, .low = 0.0, .high = 1.0, .linear = false, .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    if (temperature_column(context) < 0) return {point({0.0, 0.0})};
    return {point({0.0, 0.0}), point({0.0, 1.0})};
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (index_of(p[1]) == 0) return {.range = p[0] * at.d};
    const int column =
        at.context != nullptr && at.covariate != nullptr ? temperature_column(*at.context) : -1;
    if (column < 0 || !std::isfinite(at.covariate[column])) return {};
    return {.range = p[0] * 0.1 * (at.covariate[column] - 20.0) * at.d};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    if (index_of(p[1]) == 0) return {{"scale", p[0]}};
    return {{"expansion_per_k", 0.1 * p[0]}};
  }

 private:
  static int temperature_column(const EffectContext& context) {
    for (std::size_t i = 0; i < context.covariates.size(); ++i)
      if (context.covariates[i] == "temperature_c") return static_cast<int>(i);
    return -1;
  }
};

}  // namespace

std::unique_ptr<Effect> make_range_scale() { return std::make_unique<RangeScale>(); }

}  // namespace rangecal::effects
