// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/separation.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <utility>
#include <vector>

#include "diagnosis/projector.hpp"
#include "diagnosis/signatures.hpp"

namespace rangecal::diagnosis {
namespace {

bool spread_the_stops(const Model& model) {
  return std::all_of(model.begin(), model.end(), [](const ActiveEffect& active) {
    return active.effect->acts_on_stops() && active.effect->info().kind == EffectKind::dependence;
  });
}

Model joined(Model a, const Model& b) {
  a.insert(a.end(), b.begin(), b.end());
  return a;
}

}  // namespace

double separation(const Rows& rows, const JointState& state, const Model& causes, const Model& rivals,
                  const Model& share) {
  if (!rows.pairs && spread_the_stops(causes) && spread_the_stops(rivals))
    return stops_noncentrality(Space(rows, {}, state), commanded_under(rows, joined(share, rivals)),
                               commanded_under(rows, joined(share, causes)));
  const WorkingProblem working = working_problem(rows, {}, state);
  const Projector projector(rows, working, state);
  Signature x;
  x.range = x.bearing = Eigen::VectorXd::Zero(projector.cells());
  for (const ActiveEffect& cause : causes) {  // to first order: sum of slope times size
    bool any = false;
    for (int j = 0; j < static_cast<int>(cause.parameters.size()); ++j) {
      const EffectParameter& info = cause.effect->info().parameters[j];
      if (info.discrete || !info.linear || cause.parameters[j] == 0.0) continue;
      const Signature part = effect_signature(rows, projector, cause, j);
      any = any || projector.raw_information(part) > 0.0;
      x.range += cause.parameters[j] * part.range;
      x.bearing += cause.parameters[j] * part.bearing;
      if (!part.within()) continue;
      if (!x.within()) x.range_rows = x.bearing_rows = Eigen::VectorXd::Zero(part.range_rows.size());
      x.range_rows += cause.parameters[j] * part.range_rows;
      x.bearing_rows += cause.parameters[j] * part.bearing_rows;
    }
    if (!any) return -1.0;
  }
  std::vector<Signature> directions;
  const auto add_directions = [&](const ActiveEffect& effect) {
    const std::size_t before = directions.size();
    for (int j = 0; j < static_cast<int>(effect.parameters.size()); ++j) {
      if (effect.effect->info().parameters[j].discrete) continue;
      Signature y = effect_signature(rows, projector, effect, j);
      if (projector.raw_information(y) > 0.0) directions.push_back(std::move(y));
    }
    return directions.size() > before;
  };
  for (const ActiveEffect& rival : rivals)
    if (!add_directions(rival)) return -1.0;
  for (const ActiveEffect& effect : share) add_directions(effect);
  const Eigen::Index n = static_cast<Eigen::Index>(directions.size());
  const Eigen::VectorXd projected_x = projector.project(x);
  const double whole = projector.inner(x, projected_x, x);
  Eigen::MatrixXd information(n, n);
  Eigen::VectorXd cross(n);
  for (Eigen::Index e = 0; e < n; ++e) {
    const Eigen::VectorXd projected = projector.project(directions[e]);
    for (Eigen::Index f = 0; f < n; ++f)
      information(f, e) = projector.inner(directions[f], projected, directions[e]);
    cross[e] = projector.inner(x, projected, directions[e]);
  }
  return std::max(0.0, whole - cross.dot(information.completeOrthogonalDecomposition().solve(cross)));
}

}  // namespace rangecal::diagnosis
