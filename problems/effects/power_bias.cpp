// SPDX-License-Identifier: BSD-3-Clause
// V2. Readings that follow the power received.
//
//   delta r = c (P - P0)     [m]
//     P received power, or power less that of the first path [dB], P0 its mean over the recording c was fitted to, c [m/dB]
//
// The detector's threshold is crossed later by a weak pulse (c < 0), the leading edge earlier by a strong one. Acts on
// the reading, after the curve; an empty field counts as P0. 1 to 2 cm/dB are usual. Source: first order of the range
// bias by received power of ultra-wideband radios: Decawave APS011, 2014.
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class PowerBias final : public ColumnEffect {
 public:
  explicit PowerBias(const std::string& column = "")
      : ColumnEffect(
            {.id = "power_bias",
             .number = "V2",
             .kind = EffectKind::mean,
             .channel = "range",
             .covariate = "received_power",
             .physics =
                 "The readings shift with the power received: a weak signal crosses the detector's threshold "
                 "later than a strong one.",
             .formula = "delta r = c (P - P0) [m], c [m/dB], P the column [dB], P0 its mean in the recording",
             .source =
                 "first order of the range bias by received power of ultra-wideband radios: Decawave APS011, 2014",
             .visible_by = "vary the power at one distance, with a column of it",
             .settled_by =
                 "put an attenuator of 6 dB before the antenna, or a darker target, at one distance",
             .parameters = {{.name = "slope_m_per_db", .typical = 0.01, .low = -1.0, .high = 1.0},
                            given_by_column("reference_db", -1e9)}},
            "a column of the received power", column) {}

  bool lies_along(ColumnRole role) const override { return role == ColumnRole::received_power; }
  std::unique_ptr<Effect> along(const std::string& column) const override {
    return std::make_unique<PowerBias>(column);
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return {point({0.0, summary(context).mean})};
  }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double stronger = value(at) - p[1];
    return {.range = std::isfinite(stronger) ? p[0] * stronger : 0.0};
  }

  std::optional<ReadingChange<double>> slope(const ReadingView<double>& at, const double* p,
                                             int /*parameter*/) const override {
    const double stronger = value(at) - p[1];
    return ReadingChange<double>{.range = std::isfinite(stronger) ? stronger : 0.0};
  }

  bool changes_with_distance() const override { return false; }
};

}  // namespace

std::unique_ptr<Effect> make_power_bias() { return std::make_unique<PowerBias>(); }

}  // namespace rangecal::effects
