// SPDX-License-Identifier: BSD-3-Clause
// R9, spread. One landmark returns less light.
//
//   log s^2 -> log s^2 + v for landmark l
//     v = 2 log(spread factor) >= 0; rho^(-1/2) or rho^(-1) in its reflectance
//
// Source: derived: shot noise on a signal S ~ rho / d^2; sigma ~ rho^(-1/2), in background light rho^(-1).
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class DarkTarget final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "dark_target",
        .number = "R9",
        .kind = EffectKind::noise,
        .carrier = Carrier::light,
        .channel = "range_noise",
        .covariate = "landmark",
        .physics =
            "The readings of one landmark scatter more than their distance explains: it returns less light.",
        .formula =
            "log variance + v for one landmark l, spread factor exp(v / 2) = (rho / rho_l)^(1/2) or (rho / "
            "rho_l)",
        .source = "derived: shot noise on a signal S ~ rho / d^2",
        .visible_by = "repeats at every stop, several landmarks",
        .settled_by = "exchange two landmarks, or wrap all in the same paper; record intensity as a column",
        .settled_of_pairs = {.changes = {"E6"}},
        .parameters = {{.name = "log_variance", .typical = 1.4, .low = 0.0, .high = 12.0}, which_landmark()}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, every_landmark(context)});
  }

  std::string missing(const EffectContext& context) const override { return lacks_landmarks(context, 2); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (at.landmark != index_of(p[1])) return {};
    return {.range_log_variance = p[0]};
  }

  std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const override {
    return {{"landmark", p[1]}, {"spread_factor", std::exp(0.5 * p[0])}};
  }
};

}  // namespace

std::unique_ptr<Effect> make_dark_target() { return std::make_unique<DarkTarget>(); }

}  // namespace rangecal::effects
