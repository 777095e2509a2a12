// SPDX-License-Identifier: BSD-3-Clause
// V1. Readings that grow with a temperature that was recorded.
//
//   delta r = (a + s d) (T - T0)     [m]
//     T temperature of the column [K or degrees C], T0 its mean over the recording the coefficients were fitted to,
//     a [m/K], s [1/K]
//
// a: mount, electronics' delay; s: expansion of the baseline, frequency of the clock. Acts on the reading, after the curve; an
// empty field counts as T0. Source: first order in T of range_offset and range_scale; 0.5 mm/K and 70 to 100 ppm/K of
// plastics.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class TemperatureCoefficient final : public ColumnEffect {
 public:
  explicit TemperatureCoefficient(const std::string& column = "")
      : ColumnEffect(
            {.id = "temperature_coefficient",
             .number = "V1",
             .kind = EffectKind::mean,
             .channel = "range",
             .covariate = "temperature",
             .physics =
                 "The readings change in proportion to the temperature: mount, electronics or baseline expand.",
             .formula =
                 "delta r = (a + s d)(T - T0) [m], a [m/K], s [1/K], T the column [K or C], T0 its mean in the recording",
             .source =
                 "first order in T of range_offset and range_scale; 0.5 mm/K and 70 to 100 ppm/K of plastics",
             .visible_by = "record at temperatures 15 K apart, with a column of the temperature",
             .settled_by = "warm the sensor alone by 15 K while nothing else changes",
             .parameters = {{.name = "offset_m_per_k", .typical = 0.0005, .low = -1.0, .high = 1.0},
                            {.name = "scale_per_k", .typical = 1e-4, .low = -0.1, .high = 0.1},
                            given_by_column("reference_c", -1e9)}},
            "a column of the temperature", column) {}

  bool lies_along(ColumnRole role) const override { return role == ColumnRole::temperature; }
  std::unique_ptr<Effect> along(const std::string& column) const override {
    return std::make_unique<TemperatureCoefficient>(column);
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return {point({0.0, 0.0, summary(context).mean})};
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double warmer = value(at) - p[2];
    if (!std::isfinite(warmer)) return {};
    return {.range = (p[0] + p[1] * at.d) * warmer};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override {
    const double warmer = value(at) - p[2];
    if (!std::isfinite(warmer)) return ReadingChange<double>{};
    return ReadingChange<double>{.range = parameter == 0 ? warmer : at.d * warmer};
  }
};

}  // namespace

std::unique_ptr<Effect> make_temperature_coefficient() { return std::make_unique<TemperatureCoefficient>(); }

}  // namespace rangecal::effects
