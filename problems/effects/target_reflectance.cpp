// SPDX-License-Identifier: BSD-3-Clause
// R9. One landmark returns light differently: colour, tape, rust, a skewed spot, light that enters the
// surface.
//
//   delta r = c (d / 1 m)^m for landmark l, else 0     [m], m = 0, 1, 2
//
// Acts on the reading, after the curve. Source: a power of the distance for each landmark; colour studied for a
// low-cost triangulation lidar by Campos et al. 2015.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class TargetReflectance final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "target_reflectance",
        .number = "R9",
        .kind = EffectKind::mean,
        .carrier = Carrier::light,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "landmark",
        .physics =
            "The range to one landmark is off: its colour, tape or gloss shifts or skews the spot, or light "
            "enters its surface.",
        .formula =
            "delta r = c (d / 1 m)^m [m] for one landmark l; m = 0 (light enters the surface), 1, 2 (the "
            "spot is skewed)",
        .source =
            "a power of the distance for each landmark; colour studied for a low-cost triangulation lidar by "
            "Campos et al. 2015",
        .visible_by = "landmarks of the same make, one differing",
        .settled_by = "exchange two landmarks, or wrap all in the same paper; record intensity as a column",
        .settled_of_pairs = {.changes = {"E6"}},
        .parameters = {
            {.name = "amplitude_m", .typical = 0.015, .low = -10.0, .high = 10.0},
            which_landmark(),
            {.name = "power", .typical = 1.0, .low = 0.0, .high = 2.0, .linear = false, .discrete = true}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, every_landmark(context), {0.0, 1.0, 2.0}});
  }

  std::string missing(const EffectContext& context) const override { return lacks_landmarks(context, 2); }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (at.landmark != index_of(p[1])) return {};
    const int power = index_of(p[2]);
    return {.range = p[0] * (power == 0 ? 1.0 : power == 1 ? at.d : at.d * at.d)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_target_reflectance() { return std::make_unique<TargetReflectance>(); }

}  // namespace rangecal::effects
