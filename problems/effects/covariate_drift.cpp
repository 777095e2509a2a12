// SPDX-License-Identifier: BSD-3-Clause
// V3. Readings that follow a recorded column for which no other effect stands: supply voltage, humidity, dust, age.
//
//   delta r = (a + s d) z + q (z^2 - 1),   z = (x - x0) / w     [m]
//     x the column, x0 its mean and w its standard deviation over the recording the rest was fitted to,
//     a, q [m], s [-]
//
// Acts on the reading, after the curve; an empty field counts as x0. Less 1, the square has mean 0 as z has: the level stays
// the curve's. Source: expansion to second order in the column, to first in the distance.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class CovariateDrift final : public ColumnEffect {
 public:
  explicit CovariateDrift(const std::string& column = "")
      : ColumnEffect(
            {.id = "covariate_drift",
             .number = "V3",
             .kind = EffectKind::mean,
             .channel = "range",
             .covariate = "column",
             .physics =
                 "The readings follow this column smoothly, whatever the distance: the sensor is sensitive to what "
                 "it records.",
             .formula =
                 "delta r = (a + s d) z + q (z^2 - 1) [m], z = (x - x0) / w, x the column, x0 its mean, w its "
                 "standard deviation in the recording; a, q [m], s [-]",
             .source = "expansion to second order in the column, to first in the distance",
             .visible_by = "vary what the column records while distances stay",
             .settled_by = "hold the target still and vary what the column records alone",
             .parameters = {{.name = "offset_m", .typical = 0.005, .low = -100.0, .high = 100.0},
                            {.name = "scale", .typical = 0.002, .low = -10.0, .high = 10.0},
                            {.name = "square_m", .typical = 0.005, .low = -100.0, .high = 100.0},
                            given_by_column("reference", -1e9),
                            given_by_column("spread", 0.0)}},
            "a column that varies and is neither temperature, power nor direction", column) {}

  bool lies_along(ColumnRole role) const override {
    return role == ColumnRole::supply_voltage || role == ColumnRole::intensity || role == ColumnRole::other;
  }
  std::unique_ptr<Effect> along(const std::string& column) const override {
    return std::make_unique<CovariateDrift>(column);
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    const ColumnSummary column = summary(context);
    return {point({0.0, 0.0, 0.0, column.mean, column.std_dev})};
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double z = standardised(at, p);
    if (!std::isfinite(z)) return {};
    return {.range = (p[0] + p[1] * at.d) * z + p[2] * (z * z - 1.0)};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int parameter) const override {
    const double z = standardised(at, p);
    if (!std::isfinite(z)) return ReadingChange<double>{};
    return ReadingChange<double>{.range = parameter == 0 ? z : parameter == 1 ? at.d * z : z * z - 1.0};
  }

 private:
  double standardised(const ReadingView<double>& at, const double* p) const {
    return p[4] > 0.0 ? (value(at) - p[3]) / p[4] : 0.0;
  }
};

}  // namespace

std::unique_ptr<Effect> make_covariate_drift() { return std::make_unique<CovariateDrift>(); }

}  // namespace rangecal::effects
