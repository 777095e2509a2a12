// SPDX-License-Identifier: BSD-3-Clause
// R11. The spot is cut by the landmark's edge: the centroid of what is left of it has moved, which is read as disparity.
//
//   share of cut spots  w / R,   each off by an error with standard deviation  k d   [m]
//     w spot radius at 1/e^2 [m], R radius of the landmark [m], k = 0.20 w / s [-], s baseline of the sensor [m]
//
// Derivation: of a Gaussian spot with sigma = w / 2 whose middle lies q inside the edge, the part on the landmark has its centroid
// sigma phi(q / sigma) / Phi(q / sigma) further in. A middle outside the edge leaves less than half of the light, and no hit;
// from q = w on the shift is below 0.06 sigma. Middles are spread evenly over the width 2 R and its two edges: a share w / R
// is cut, by shifts of either sign whose mean square is sigma^2 / 2 times the integral of (phi / Phi)^2 over [0, 2], (0.40 sigma)^2 =
// (0.20 w)^2. A centroid that moved by u reads as (d / s) u. Taken as normal. Neither spot nor baseline is known: w and k are
// estimated apart, so that a spot of another profile, which changes the 0.20 alone, is the same law.
//
// Source: derived: the centroid of a Gaussian spot cut by an edge, moved by u, reads as (d / s) u; Curless and Levoy 1995
// ("Better optical triangulation through spacetime analysis", on spots cut by edges).
#include <algorithm>

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
            "share w / R of hits has a further error N(0, (k d)^2) [m], w spot radius [m], k = 0.20 w / s [-], "
            "s baseline [m]",
        .source =
            "derived: the centroid of a Gaussian spot cut by an edge, moved by u, reads as (d / s) u; Curless and "
            "Levoy 1995",
        .visible_by = "landmarks of several radii",
        .settled_by =
            "drop the outermost hit on each side and extract again; use larger landmarks before an empty "
            "background",
        .settled_of_pairs = {.otherwise = "use larger targets before an empty background"},
        .parameters = {
            {.name = "spot_radius_m", .typical = 0.002, .low = 0.0, .high = 0.02, .linear = false},
            {.name = "relative_error", .typical = 0.01, .low = 0.0, .high = 0.2, .linear = false}}};
    return value;
  }

  std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const override {
    return grid_of({{0.0005, 0.002, 0.008}, {0.003, 0.01, 0.04}});
  }

  std::string missing(const EffectContext& context) const override {
    const std::string radii = context.largest_cell >= 1.0 ? lacks_radii(context) : "";
    return radii.empty() ? radii : radii + ": a flat target has no edge";
  }

  Contamination contamination(const ReadingView<double>& at, const double* p) const override {
    if (!(at.radius > 0.0)) return {};
    return {.share = std::min(p[0] / at.radius, 0.5), .extra_sigma_m = p[1] * at.d};
  }
};

}  // namespace

std::unique_ptr<Effect> make_mixed_pixels() { return std::make_unique<MixedPixels>(); }

}  // namespace rangecal::effects
