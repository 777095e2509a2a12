// SPDX-License-Identifier: BSD-3-Clause
// R17. The radius of one landmark is wrong: R_true = R + delta R.
//
//   delta d = -delta R for landmark l, else 0     [m]
//
// Acts before the curve: delta r = f(d - delta R) - f(d). Source: derived: d = D - R.
#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class LandmarkRadius final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "landmark_radius",
        .number = "R17",
        .kind = EffectKind::mean,
        .stage = Stage::path,
        .channel = "range",
        .covariate = "landmark",
        .physics = "The stated radius of one landmark is wrong.",
        .formula = "delta d = -delta R [m] for one landmark l, before the curve: delta r = -f'(d) delta R",
        .source = "derived: d = D - R",
        .visible_by = "one landmark seen from several sides",
        .settled_by = "measure the landmark with a calliper",
        .settled_of_pairs = {.otherwise = "measure the targets with a calliper"},
        .parameters = {{.name = "error_m", .typical = 0.005, .low = -1.0, .high = 1.0}, which_landmark()}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext& context) const override {
    return grid_of({{0.0}, every_landmark(context)});
  }

  std::string missing(const EffectContext& context) const override {
    // Known distances are those to the surface.
    const std::string radii = context.kind == RecordingKind::pairs ? lacks_radii(context) : "";
    return either(lacks_landmarks(context, 2), radii);
  }

  bool differs_between_repeats() const override { return false; }

  ReadingChange<double> reading(const ReadingView<double>& at, const double* p) const override {
    if (at.landmark != index_of(p[1])) return {};
    return {.range = at.before_curve(-p[0])};
  }
};

}  // namespace

std::unique_ptr<Effect> make_landmark_radius() { return std::make_unique<LandmarkRadius>(); }

}  // namespace rangecal::effects
