// SPDX-License-Identifier: BSD-3-Clause
// Effects at their typical size, and the range error that they cause if ignored.
#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/signatures.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr int most_grid_starts = 12;  ///< points of a start grid that are looked at

}  // namespace

std::optional<TypicalEffect> typical_effect(const Space& space, const Effect& effect) {
  const EffectInfo& info = effect.info();
  const EffectContext& context = space.rows().context;
  if (info.kind == EffectKind::label || info.kind == EffectKind::grid || !effect.lacking(context).empty())
    return std::nullopt;
  std::vector<Eigen::VectorXd> grid = effect.start_grid(context);
  if (grid.empty()) return std::nullopt;
  if (grid.size() > most_grid_starts) {
    std::vector<Eigen::VectorXd> thinned;
    for (int j = 0; j < most_grid_starts; ++j)
      thinned.push_back(grid[static_cast<std::size_t>(j) * (grid.size() - 1) / (most_grid_starts - 1)]);
    grid = std::move(thinned);
  }
  std::optional<TypicalEffect> best;
  const auto consider = [&](const Eigen::VectorXd& parameters, int index) {
    TypicalEffect candidate;
    candidate.active = {&effect, parameters};
    candidate.index = index;
    candidate.direction = space.change({candidate.active});
    candidate.noncentrality = candidate.direction.information + shape_noncentrality(space, candidate.active);
    constexpr double nothing = 1e-6;  // below it rounding would choose
    const bool better = !best || (std::max(candidate.noncentrality, best->noncentrality) < nothing
                                      ? candidate.direction.raw > best->direction.raw
                                      : candidate.noncentrality > best->noncentrality);
    if (better) best = std::move(candidate);
  };
  const int count = static_cast<int>(info.parameters.size());
  for (const Eigen::VectorXd& start : grid) {
    bool linear = false;
    for (int j = 0; j < count; ++j) {
      if (!info.parameters[static_cast<std::size_t>(j)].linear ||
          info.parameters[static_cast<std::size_t>(j)].discrete)
        continue;
      linear = true;
      Eigen::VectorXd p = start;
      for (int a = 0; a < count; ++a)
        if (info.parameters[static_cast<std::size_t>(a)].linear) p[a] = 0.0;
      p[j] = info.parameters[static_cast<std::size_t>(j)].typical;
      consider(p, j);
    }
    if (linear) continue;
    double largest =
        0.0;  // in typical sizes; of signed parameters, which are coordinates of one thing, the length
    for (int j = 0; j < count; ++j) {
      const EffectParameter& parameter = info.parameters[static_cast<std::size_t>(j)];
      if (parameter.discrete) continue;
      const double size = std::abs(start[j]) / size_of(parameter);
      largest = parameter.low < 0.0 ? std::hypot(largest, size) : std::max(largest, size);
    }
    Eigen::VectorXd p = start;
    for (int j = 0; j < count; ++j)
      if (largest > 0.0 && !info.parameters[static_cast<std::size_t>(j)].discrete) p[j] /= largest;
    consider(p, -1);
  }
  return best;
}

ActiveEffect scaled(const TypicalEffect& typical, double factor) {
  ActiveEffect active = typical.active;
  const auto& parameters = active.effect->info().parameters;
  for (Eigen::Index j = 0; j < active.parameters.size(); ++j)
    if (typical.index >= 0 ? j == typical.index : !parameters[static_cast<std::size_t>(j)].discrete)
      active.parameters[j] *= factor;
  return active;
}

double range_error_of(const Space& space, const TypicalEffect& typical) {
  const EffectInfo& info = typical.active.effect->info();
  const Projector& projector = space.projector();
  const CellGeometry& g = space.geometry();
  Eigen::VectorXd phi, stops;
  projector.absorbed(typical.direction.mean, phi, stops);
  const int alphas = projector.system().layout().alpha_count;
  const auto [low, high] = std::minmax_element(g.d.begin(), g.d.end());
  const bool of_curve = (info.kind == EffectKind::mean || info.kind == EffectKind::tail) &&
                        info.channel.substr(0, 5) == "range" &&
                        (info.covariate == "range" || info.covariate == "disparity");
  constexpr int points = 400;
  double square = 0.0;
  for (int j = 0; j < points; ++j) {
    const double d = *low + (*high - *low) * (j + 0.5) / points;
    // The nearest cell lends f, its slope and spread: they are taken along the fitted curve.
    std::size_t near = 0;
    for (std::size_t c = 1; c < g.d.size(); ++c)
      if (std::abs(g.d[c] - d) < std::abs(g.d[near] - d)) near = c;
    const double step = d - g.d[near];
    ReadingView<double> view =
        view_of(space.rows(), g, static_cast<std::size_t>(space.rows().cell_begin[static_cast<int>(near)]));
    view.d = d;
    view.f = g.f[near] + step * (g.slope[near] + 0.5 * step * g.curvature[near]);
    view.slope = g.slope[near] + step * g.curvature[near];
    double error = evaluate_polynomial(phi.head(alphas), space.rows().curve.scale.of(d));
    if (of_curve) error -= typical.active.effect->reading(view, typical.active.parameters.data()).range;
    if (view.slope == 0.0) return std::numeric_limits<double>::infinity();  // no reading tells a distance
    square += std::pow(error / view.slope, 2);
  }
  return std::sqrt(square / points);
}

}  // namespace rangecal::diagnosis
