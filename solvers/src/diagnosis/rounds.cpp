// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/rounds.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal::diagnosis {
namespace {

constexpr double reach = 3.0;      ///< standard deviations of d within which a side is uncertain
constexpr double beyond_m = 1e-6;  ///< how far over L a cell is put

/// Variance of each stop's position along a line of sight [m^2]: its prior's, and half of the information of
/// its ranges (their directions are spread over both axes).
std::vector<double> position_variance(const Rows& rows, const CellGeometry& geometry,
                                      const JointProblem& problem) {
  std::vector<double> information(problem.stops.size(), 0.0);
  for (int c = 0; c < rows.cell_count; ++c)
    information[problem.cells.stop[c]] +=
        0.5 * problem.cells.range_weight[c] * std::pow(geometry.slope[c] / geometry.spread[c], 2);
  std::vector<double> variance(problem.stops.size(), 0.0);
  for (std::size_t k = 0; k < variance.size(); ++k) {
    const double sigma = problem.stops[k].sigma_xy_m;
    if (sigma > 0.0) variance[k] = 1.0 / (1.0 / (sigma * sigma) + information[k]);
  }
  return variance;
}

/// Moves the place of stop k so that cell c gets distance d.
void move_to(const JointProblem& problem, const CellGeometry& geometry, int c, double d, JointState& state) {
  const int place = problem.stops[problem.cells.stop[c]].place;
  const Eigen::Vector2d shift = (geometry.d[c] - d) * geometry.n[c];
  for (std::size_t k = 0; k < state.stops.size(); ++k) {
    if (problem.stops[k].place != place) continue;
    state.stops[k].x_m += shift.x();
    state.stops[k].y_m += shift.y();
  }
}

/// Mean change of a cell's ranges by one effect at distance d.
double change_at(const Rows& rows, const CellGeometry& geometry, const ActiveEffect& active, int c,
                 double d) {
  double sum = 0.0;
  for (int i = rows.cell_begin[c]; i < rows.cell_begin[c + 1]; ++i) {
    ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(i));
    view.d = d;
    sum += active.effect->reading(view, active.parameters.data()).range;
  }
  return sum / (rows.cell_begin[c + 1] - rows.cell_begin[c]);
}

}  // namespace

bool Sides::matter(const Model& model) {
  return std::any_of(model.begin(), model.end(), [](const ActiveEffect& active) {
    return std::isfinite(active.effect->switching_distance(active.parameters.data()));
  });
}

void Sides::settle(const Rows& rows, const Model& model, JointState& state) {
  near_.clear();
  for (const ActiveEffect& active : model) {
    const double limit = active.effect->switching_distance(active.parameters.data());
    if (!std::isfinite(limit)) continue;
    const WorkingProblem working = working_problem(rows, model, state);
    const CellGeometry geometry = cell_geometry(rows, state);
    const std::vector<double> variance = position_variance(rows, geometry, working.problem);
    const Cells& cells = working.problem.cells;
    for (int c = 0; c < rows.cell_count; ++c) {
      const double off = geometry.d[c] - limit, v = variance[cells.stop[c]];
      const bool near = off < 0.0;
      const double over = limit + (near ? beyond_m : -beyond_m);
      bool crossed = false;
      if (off * off < reach * reach * v) {
        const double weight = cells.range_weight[c] / (geometry.spread[c] * geometry.spread[c]);
        const double here = cells.range_mean[c] - geometry.f[c];
        const double there = here + change_at(rows, geometry, active, c, geometry.d[c]) -
                             change_at(rows, geometry, active, c, over);
        crossed = weight * there * there + off * off / v < weight * here * here;
      }
      if (crossed) move_to(working.problem, geometry, c, over, state);
      near_.push_back(near != crossed);
    }
  }
}

double Sides::restore(const Rows& rows, const Model& model, JointState& state) const {
  double cost = 0.0;
  std::size_t at = 0;
  for (const ActiveEffect& active : model) {
    const double limit = active.effect->switching_distance(active.parameters.data());
    if (!std::isfinite(limit)) continue;
    const CellGeometry geometry = cell_geometry(rows, state);
    const std::vector<double> variance = position_variance(rows, geometry, rows.problem);
    for (int c = 0; c < rows.cell_count; ++c, ++at) {
      const double off = geometry.d[c] - limit, v = variance[rows.problem.cells.stop[c]];
      const bool near = off < 0.0;
      if (near == static_cast<bool>(near_[at]) || !(v > 0.0)) continue;
      cost += 0.5 * off * off / v;
      move_to(rows.problem, geometry, c, limit + (near ? beyond_m : -beyond_m), state);
    }
  }
  return cost;
}

WorkingProblem Rounds::begin(const Rows& rows, const Model& model, JointState& state) {
  if (jumps_) sides_.settle(rows, model, state);
  WorkingProblem working = working_problem(rows, model, state);
  bends_ = !working.problem.cells.bend.empty();
  return working;
}

bool Rounds::another(const Rows& rows, const Model& model, JointState& state, double& value) {
  constexpr int most = 5;
  constexpr double settled = 1e-2;  // nats
  if (jumps_) value += sides_.restore(rows, model, state);
  ++done_;
  if (--left_ == 0 && bends_ && done_ < most && !(std::abs(value - before_) < settled)) ++left_;
  before_ = value;
  return left_ > 0;
}

}  // namespace rangecal::diagnosis
