// SPDX-License-Identifier: BSD-3-Clause
// N6. The noise enters before the reciprocal: on the spot's place x = f s / d.
//
//   cv = sigma_x / x = c f [-], c [1/m],   delta r = cv^2 f = c^2 f^3     [m], skewness about 6 cv
//     f the reading without noise [m]
//
// The likelihood is exact: x = 1 / y is Gaussian, so c is the sensor's own noise and no parameter of its own.
// reading() gives the shift of the mean, for signatures: second order of 1 / (1 + e) with e ~ N(0, cv^2). Acts on the
// reading, after the curve. Source: derived: second moment of 1 / (1 + e).
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::effects {
namespace {

class ReciprocalNoise final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "reciprocal_noise",
        .number = "N6",
        .kind = EffectKind::tail,
        .carrier = Carrier::light,
        .channel = "range_tail",
        .covariate = "range",
        .physics =
            "Far readings are skewed to the far side and too long on average: the noise sits on the spot's "
            "place, before the division.",
        .formula =
            "cv = c f [-], c [1/m], f the reading without noise [m]: delta r = cv^2 f [m], skewness about 6 cv",
        .source = "derived: second moment of 1 / (1 + e)",
        .visible_by = "many repeats at far ranges",
        .settled_by = "200 sweeps at one near, one middle and one far stop: skewness grows with distance",
        .settled_of_pairs = {.changes = {"E7"}},
        .parameters = {{.name = "cv_per_m",
                        .typical = 0.02,
                        .low = 0.0,
                        .high = 0.2,
                        .linear = false,
                        .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override { return grid_of({{0.02}}); }

  bool noise_before_reciprocal() const override { return true; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    const double cv = p[0] * at.f;
    return {.range = cv * cv * at.f};
  }
};

}  // namespace

std::unique_ptr<Effect> make_reciprocal_noise() { return std::make_unique<ReciprocalNoise>(); }

}  // namespace rangecal::effects
