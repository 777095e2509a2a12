// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/alternation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <utility>

#include "diagnosis/stop_modes.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double side_reach = 3.0;  ///< standard deviations of d within which a side is uncertain
constexpr double beyond_m = 1e-6;   ///< how far over L a cell is put

/// Cells in which one landmark is seen from one place: they have one distance, and lie on one side.
using LineOfSight = std::vector<int>;

std::vector<LineOfSight> lines_of_sight(const JointProblem& problem) {
  std::map<std::pair<int, int>, LineOfSight> lines;
  for (std::size_t c = 0; c < problem.cells.size(); ++c) {
    const int place = problem.stops[static_cast<std::size_t>(problem.cells.stop[c])].place;
    lines[{place, problem.cells.landmark[c]}].push_back(static_cast<int>(c));
  }
  std::vector<LineOfSight> list;
  for (auto& [ends, cells] : lines) list.push_back(std::move(cells));
  return list;
}

/// Variance of each place along a line of sight [m^2]: its prior's, and half of the information of its ranges
/// (their directions are spread over both axes).
class PlaceVariance {
 public:
  PlaceVariance(const Rows& rows, const CellGeometry& geometry, const JointProblem& problem)
      : problem_(problem), information_(static_cast<std::size_t>(problem.place_count), 0.0) {
    const Cells& cells = problem.cells;
    for (int c = 0; c < rows.cell_count; ++c)
      information_[place_of(c)] +=
          0.5 * cells.range_weight[c] * std::pow(geometry.slope[c] / geometry.spread[c], 2);
    prior_.assign(information_.size(), 0.0);
    for (const StopPrior& stop : problem.stops)
      if (stop.opens_place) prior_[static_cast<std::size_t>(stop.place)] = stop.sigma_xy_m * stop.sigma_xy_m;
  }
  /// Of the place from which cell c was seen; 0 where it is exact.
  double of(int c) const {
    const double prior = prior_[place_of(c)];
    return prior > 0.0 ? 1.0 / (1.0 / prior + information_[place_of(c)]) : 0.0;
  }

 private:
  std::size_t place_of(int c) const {
    return static_cast<std::size_t>(problem_.stops[problem_.cells.stop[c]].place);
  }
  const JointProblem& problem_;
  std::vector<double> information_, prior_;
};

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

void Sides::begin(const Rows& rows, const Model& model) {
  of_cells_.assign(model.size(), {});
  for (std::size_t e = 0; e < model.size(); ++e) {
    const double limit = model[e].effect->switching_distance(model[e].parameters.data());
    if (std::isfinite(limit))
      of_cells_[e] = {limit, std::vector<char>(static_cast<std::size_t>(rows.cell_count))};
  }
}

void Sides::OfCells::put(const std::vector<int>& line, bool on_near_side) {
  for (int c : line) near[static_cast<std::size_t>(c)] = on_near_side;
}

void Sides::take(const Rows& rows, const Model& model, const JointState& state) {
  begin(rows, model);
  const CellGeometry geometry = cell_geometry(rows, state);
  const std::vector<LineOfSight> lines = lines_of_sight(rows.problem);
  for (OfCells& sides : of_cells_)
    for (const LineOfSight& line : lines)
      if (sides.jumps()) sides.put(line, geometry.d[line.front()] < sides.limit);
}

void Sides::settle(const Rows& rows, const Model& model, JointState& state) {
  begin(rows, model);
  for (std::size_t e = 0; e < model.size(); ++e) {
    const ActiveEffect& active = model[e];
    if (!of_cells_[e].jumps()) continue;
    const double limit = of_cells_[e].limit;
    const WorkingProblem working = working_problem(rows, model, state);
    const CellGeometry geometry = cell_geometry(rows, state);
    const PlaceVariance variance(rows, geometry, working.problem);
    const Cells& cells = working.problem.cells;
    for (const LineOfSight& line : lines_of_sight(working.problem)) {
      const int first = line.front();
      const double off = geometry.d[first] - limit, v = variance.of(first);
      const bool near = off < 0.0;
      const double over = limit + (near ? beyond_m : -beyond_m);
      bool crossed = false;
      if (off * off < side_reach * side_reach * v) {
        double gain = -off * off / v;
        for (int c : line) {
          const double weight = cells.range_weight[c] / (geometry.spread[c] * geometry.spread[c]);
          const double here = cells.range_mean[c] - geometry.f[c];
          const double there = here + change_at(rows, geometry, active, c, geometry.d[c]) -
                               change_at(rows, geometry, active, c, over);
          gain += weight * (here * here - there * there);
        }
        crossed = gain > 0.0;
      }
      if (crossed) move_to(working.problem, geometry, first, over, state);
      of_cells_[e].put(line, near != crossed);
    }
  }
}

ReadingView<double> Sides::seen_by(std::size_t effect, int cell, ReadingView<double> view) const {
  const OfCells& sides = of_cells_[effect];
  if (!sides.jumps()) return view;
  view.d = sides.near[static_cast<std::size_t>(cell)] ? std::min(view.d, sides.limit - beyond_m)
                                                      : std::max(view.d, sides.limit + beyond_m);
  return view;
}

double Sides::restore(const Rows& rows, JointState& state) const {
  double cost = 0.0;
  for (const OfCells& sides : of_cells_) {
    if (!sides.jumps()) continue;
    const CellGeometry geometry = cell_geometry(rows, state);
    const PlaceVariance variance(rows, geometry, rows.problem);
    for (const LineOfSight& line : lines_of_sight(rows.problem)) {
      const int first = line.front();
      const double off = geometry.d[first] - sides.limit, v = variance.of(first);
      const bool near = off < 0.0;
      if (near == static_cast<bool>(sides.near[static_cast<std::size_t>(first)]) || !(v > 0.0)) continue;
      cost += 0.5 * off * off / v;
      move_to(rows.problem, geometry, first, sides.limit + (near ? beyond_m : -beyond_m), state);
    }
  }
  return cost;
}

std::vector<std::pair<Model, JointState>> Sides::others(const Rows& rows, const Model& model,
                                                        const JointState& state) {
  constexpr std::size_t most = 8;
  std::vector<std::pair<double, std::pair<Model, JointState>>> found;
  const CellGeometry geometry = cell_geometry(rows, state);
  const PlaceVariance variance(rows, geometry, rows.problem);
  const std::vector<LineOfSight> lines = lines_of_sight(rows.problem);
  for (std::size_t e = 0; e < model.size(); ++e) {
    const ActiveEffect& active = model[e];
    const double limit = active.effect->switching_distance(active.parameters.data());
    if (!std::isfinite(limit)) continue;
    const auto parameter =
        std::find(active.parameters.data(), active.parameters.data() + active.parameters.size(), limit) -
        active.parameters.data();
    if (parameter == active.parameters.size()) continue;  // not one to be moved
    double last_near = -std::numeric_limits<double>::max(),
           first_far = -last_near;  // between them nothing changes sides with L
    for (const LineOfSight& line : lines) {
      const double d = geometry.d[line.front()];
      if (d < limit)
        last_near = std::max(last_near, d);
      else
        first_far = std::min(first_far, d);
    }
    for (const LineOfSight& line : lines) {
      const int cell = line.front();
      const double d = geometry.d[cell], v = variance.of(cell);
      const double moved_limit = d < limit ? last_near + beyond_m : first_far - beyond_m;
      const double jump = change_at(rows, geometry, active, cell, limit - beyond_m) -
                          change_at(rows, geometry, active, cell, limit + beyond_m);
      if (!(v > 0.0) || std::abs(d - moved_limit) > std::abs(jump) + side_reach * std::sqrt(v)) continue;
      Model moved_model = model;
      moved_model[e].parameters[parameter] = moved_limit;
      JointState moved = state;
      move_to(rows.problem, geometry, cell, moved_limit + (d < limit ? beyond_m : -beyond_m), moved);
      found.push_back({std::abs(d - moved_limit), {std::move(moved_model), std::move(moved)}});
    }
  }
  std::sort(found.begin(), found.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::pair<Model, JointState>> others;
  for (std::size_t i = 0; i < std::min(found.size(), most); ++i) others.push_back(std::move(found[i].second));
  return others;
}

namespace {

/// True if the fit moved so little that effects and tails, evaluated anew where it ended, do not change the value by what
/// matters.
bool hardly_moved(const Rows& rows, const JointState& from, const JointState& to) {
  constexpr double little = 1e-3;  // nats
  const CellGeometry before = cell_geometry(rows, from), after = cell_geometry(rows, to);
  double sum = 0.0;
  for (std::size_t c = 0; c < after.f.size(); ++c) {
    const double off = (after.f[c] - before.f[c]) / after.spread[c];
    const double ratio = after.spread[c] / before.spread[c] - 1.0;
    sum += 0.5 * off * off + ratio * ratio;
  }
  return sum < little;
}

}  // namespace

WorkingProblem Alternation::begin(const Rows& rows, const Model& model, JointState& state) {
  jumps_ = jumps_ && !rows.pairs;  // whose distances are known
  if (rows.pairs) begun_ = state;
  if (jumps_) sides_.settle(rows, model, state);
  WorkingProblem working = working_problem(rows, model, state);
  has_effect_slope_ = !working.problem.cells.effect_slope.empty();
  if (has_effect_slope_ &&
      move_places_to_modes(rows, model, working, done_ == 0 ? ModeSearch::all : ModeSearch::nearest, state))
    working = working_problem(rows, model, state);
  return working;
}

bool Alternation::another(const Rows& rows, JointState& state, double& value) {
  constexpr int most = 5;
  constexpr double settled = 1e-2;  // nats
  if (jumps_) value += sides_.restore(rows, state);
  ++done_;
  if (rows.pairs && left_ > 1 && !exact_ && !has_effect_slope_ && hardly_moved(rows, begun_, state))
    left_ = 1;
  if (--left_ == 0 && (has_effect_slope_ || exact_) && done_ < most && !(std::abs(value - before_) < settled))
    ++left_;
  before_ = value;
  return left_ > 0;
}

}  // namespace rangecal::diagnosis
