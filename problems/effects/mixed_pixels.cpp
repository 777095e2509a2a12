// SPDX-License-Identifier: BSD-3-Clause
// R11. The spot is clipped at the landmark's edge: its centroid moves in the scan plane, read as
// disparity.
//
//   share of clipped hits  w / R,   error of one  +-(d / s) (w / 2)     [m]
//   a contaminated normal: the clipped share has the extra variance (d w / (2 s))^2 / 3 of an even spread
//     w spot radius on the target [m], R radius of the landmark [m], s = 0.05 m baseline
//
// Source: derived: a spot centroid moved by du reads as (d / s) du; Curless and Levoy on spot shape. Clipping by half
// the spot radius and the baseline of 50 mm are assumed, so w is known up to the factor (s / 0.05 m)^(2/3).
#include <algorithm>
#include <cmath>

#include "rangecal/problems/effects/effect.hpp"
#include "shapes.hpp"

namespace rangecal::effects {
namespace {

class MixedPixels final : public Effect {
 public:
  const EffectInfo& info() const override {
    static const EffectInfo value{
        .id = "mixed_pixels",
        .number = "R11",
        .kind = EffectKind::tail,
        .carrier = Carrier::light,
        .channel = "range_tail",
        .covariate = "radius",
        .physics =
            "Some readings miss by far, more on thin landmarks: the spot is cut by the landmark's edge.",
        .formula =
            "share w / R of hits is off by +-(d / s)(w / 2) [m], w spot radius [m], s = 0.05 m baseline; "
            "evenly spread",
        .source = "derived: a spot centroid moved by du reads as (d / s) du; Curless and Levoy on spot shape",
        .visible_by = "landmarks of several radii",
        .settled_by =
            "drop the outermost hit on each side and extract again; use larger landmarks before an empty "
            "background",
        .settled_of_pairs = {.otherwise = "use larger targets before an empty background"},
        .parameters = {
            {.name = "spot_radius_m", .typical = 0.002, .low = 0.0, .high = 0.02, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0005, 0.001, 0.002, 0.004, 0.008}});
  }

  std::string missing(const EffectContext& context) const override {
    const std::string radii = context.largest_cell >= 1.0 ? lacks_radii(context) : "";
    return radii.empty() ? radii : radii + ": a flat target has no edge";
  }

  Contamination contamination(const ReadingView<double>& at, const double* p) const override {
    constexpr double baseline_m = 0.05;
    if (!(at.radius > 0.0)) return {};
    // Hits within w of an edge: their centroid moves by up to w / 2, evenly; a share w / R of all.
    return {.share = std::min(p[0] / at.radius, 0.5),
            .extra_sigma_m = 0.5 * p[0] * at.d / baseline_m / std::sqrt(3.0)};
  }
};

}  // namespace

std::unique_ptr<Effect> make_mixed_pixels() { return std::make_unique<MixedPixels>(); }

}  // namespace rangecal::effects
