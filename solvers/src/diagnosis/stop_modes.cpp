// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/stop_modes.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include "diagnosis/alternation.hpp"
#include "rangecal/core/angles.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double reach = 3.0;       ///< standard deviations of a place that the grid covers
constexpr double grid_phase = 0.8;  ///< of a period, between points of the grid [rad]
constexpr double table_phase = 0.15;
constexpr int widest = 20;     ///< points of the grid on either side
constexpr double worth = 0.3;  ///< nats below which a place stays
constexpr double faint = 0.3;  ///< of a cell's error: an oscillation below it needs no resolution

double range_information(const WorkingCells& working, const CellGeometry& geometry, int cell) {
  return working.problem.cells.range_weight[cell] / (geometry.spread[cell] * geometry.spread[cell]);
}

/// How far about d an oscillation is looked at [m]: over a tenth of d where that is close by,
/// since a period may grow with its square.
double within_m(double d) { return std::min(0.012, 0.1 * std::abs(d)); }

/// The effects of a model on the mean range, as functions of the distance about each cell.
struct OscillatingEffects {
  Model effects;              ///< those that are no straight lines
  std::vector<double> slope;  ///< of all others, by cell [m/m]
};

/// `sides`: those that jump are then straight lines on their side.
OscillatingEffects oscillating_effects(const Rows& rows, const Model& model, const WorkingCells& working,
                                       const CellGeometry& geometry, const Sides* sides) {
  constexpr std::array places{-0.52, 0.33, 0.76};
  constexpr double straight = 0.1 * faint;  // of a cell's error
  OscillatingEffects oscillating;
  oscillating.slope.assign(static_cast<std::size_t>(rows.cell_count), 0.0);
  std::vector<double> slope(oscillating.slope.size());
  for (std::size_t e = 0; e < model.size(); ++e) {
    const ActiveEffect& active = model[e];
    if (active.effect->info().kind != EffectKind::mean || !active.effect->changes_with_distance()) continue;
    const bool jumps = std::isfinite(active.effect->switching_distance(active.parameters.data()));
    if (jumps && sides) {
      for (int c = 0; c < rows.cell_count; ++c) {
        const ReadingView<double> view =
            view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
        oscillating.slope[static_cast<std::size_t>(c)] += effect_slope_of(active, sides->seen_by(e, c, view));
      }
      continue;
    }
    bool oscillates = jumps;
    for (int c = 0; c < rows.cell_count && !oscillates; ++c) {
      const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[c]));
      const double reach_m = within_m(view.d);
      const double least = straight / (reach_m * std::sqrt(range_information(working, geometry, c)));
      slope[c] = effect_slope_of(active, view);
      for (const double place : places)
        oscillates = oscillates ||
                     std::abs(effect_slope_of(active, moved_by(view, place * reach_m)) - slope[c]) > least;
    }
    if (oscillates) {
      oscillating.effects.push_back(active);
      continue;
    }
    for (std::size_t c = 0; c < slope.size(); ++c) oscillating.slope[c] += slope[c];
  }
  return oscillating;
}

/// One cell as its place sees it: h(d) in a table, the curve to second order, the bearing to first.
class OscillatingCell {
 public:
  OscillatingCell(const Rows& rows, const OscillatingEffects& oscillating, const WorkingCells& working,
                  const CellGeometry& geometry, const JointState& state, int cell)
      : rows_(&rows),
        model_(&oscillating.effects),
        slope_(oscillating.slope[cell]),
        cell_(cell),
        view_(view_of(rows, geometry, first_row())) {
    const Cells& c = working.problem.cells;
    information_ = range_information(working, geometry, cell);
    bearing_information_ = c.bearing_weight[cell] / (state.sigma_theta_rad * state.sigma_theta_rad);
    sight_ = geometry.axis_distance[cell] * geometry.n[cell];
    across_ = geometry.t[cell] / geometry.axis_distance[cell];
    bearing_error_ = wrap_angle(c.bearing_mean[cell] - geometry.bearing[cell]);
    // What these effects took out of the mean comes back: the sum wants y - h at other distances.
    error_ = c.range_mean[cell] + change(0.0) - view_.f;
    measure();
  }

  /// Variance of the cell's mean range with the oscillation counted as an error, as information on d [1/m^2].
  double open_information() const {
    return view_.slope * view_.slope / (1.0 / information_ + amplitude_ * amplitude_);
  }
  /// Phase of the oscillation per metre, 0 where it does not matter [rad/m].
  double wavenumber() const { return amplitude_ * std::sqrt(information_) > faint ? wavenumber_ : 0.0; }

  /// Tabulates h within `reach_m` of d.
  void tabulate(double reach_m) {
    step_ = wavenumber() > 0.0 ? table_phase / wavenumber() : reach_m;
    const int half = static_cast<int>(std::ceil(reach_m / step_)) + 1;
    table_.resize(static_cast<std::size_t>(2 * half + 1));
    for (int j = -half; j <= half; ++j) table_[static_cast<std::size_t>(j + half)] = change(step_ * j);
    middle_ = half;
  }

  double cost(const Eigen::Vector2d& u) const {
    const double moved = (sight_ - u).norm() - view_.axis_distance;
    const double error = error_ - moved * (view_.slope + 0.5 * view_.curvature * moved) - looked_up(moved);
    const double bearing = bearing_error_ + across_.dot(u);
    return 0.5 * (information_ * error * error + bearing_information_ * bearing * bearing);
  }

 private:
  std::size_t first_row() const { return static_cast<std::size_t>(rows_->cell_begin[cell_]); }

  double change(double moved) const {
    const ReadingView<double> view = moved_by(view_, moved);
    double sum = slope_ * moved;
    for (const ActiveEffect& active : *model_)
      sum += active.effect->reading(view, active.parameters.data()).range;
    return sum;
  }

  /// Amplitude and phase per metre of h about d, from samples that no period repeats.
  void measure() {
    const double reach_m = within_m(view_.d);
    constexpr std::array places{-0.97, -0.71, -0.52, -0.33, -0.19, -0.07, 0.04, 0.21, 0.38, 0.55, 0.76, 1.0};
    double sum = 0.0, square = 0.0, slope_square = 0.0, slope_sum = 0.0;
    for (double place : places) {
      const ReadingView<double> at = moved_by(view_, place * reach_m);
      const double h = change(place * reach_m);
      double slope = slope_;
      for (const ActiveEffect& active : *model_) slope += effect_slope_of(active, at);
      sum += h;
      square += h * h;
      slope_sum += slope;
      slope_square += slope * slope;
    }
    const double n = static_cast<double>(places.size());
    const double variance = std::max(square - sum * sum / n, 0.0) / n;
    const double slope_variance = std::max(slope_square - slope_sum * slope_sum / n, 0.0) / n;
    amplitude_ = std::sqrt(2.0 * variance);
    wavenumber_ = variance > 0.0 ? std::sqrt(slope_variance / variance) : 0.0;
  }

  double looked_up(double moved) const {
    const double at = std::clamp(moved / step_ + middle_, 0.0, static_cast<double>(table_.size() - 1) - 1e-9);
    const auto below = static_cast<std::size_t>(at);
    const double part = at - static_cast<double>(below);
    return table_[below] + part * (table_[below + 1] - table_[below]);
  }

  const Rows* rows_;
  const Model* model_;
  double slope_;  ///< of the effects that are straight lines
  int cell_, middle_ = 0;
  ReadingView<double> view_;
  Eigen::Vector2d sight_, across_;
  double information_ = 0.0, bearing_information_ = 0.0, error_ = 0.0, bearing_error_ = 0.0;
  double amplitude_ = 0.0, wavenumber_ = 0.0, step_ = 1.0;
  std::vector<double> table_;
};

/// The cells of a place and its prior.
struct OscillatingPlace {
  std::vector<OscillatingCell> cells;
  Eigen::Vector2d error = Eigen::Vector2d::Zero();  ///< of the place, from where it was commanded [m]
  double prior_information = 0.0;

  /// By the prior of the stop that opens it, which stands at `pose`.
  void hold(const StopPrior& prior, const Pose2& pose) {
    prior_information = 1.0 / (prior.sigma_xy_m * prior.sigma_xy_m);
    error = {pose.x_m - prior.commanded.x_m, pose.y_m - prior.commanded.y_m};
  }

  double cost(const Eigen::Vector2d& u) const {
    double sum = 0.5 * prior_information * (error + u).squaredNorm();
    for (const OscillatingCell& cell : cells) sum += cell.cost(u);
    return sum;
  }
};

/// The least cost downhill from u, by steps that halve; u moves there.
double descend(const OscillatingPlace& place, double step, Eigen::Vector2d& u) {
  constexpr int longest_walk = 200;  // steps: a minimum lies within a few, a slope without end leads nowhere
  const std::array<Eigen::Vector2d, 4> ways{{{1.0, 0.0}, {-1.0, 0.0}, {0.0, 1.0}, {0.0, -1.0}}};
  double least = place.cost(u);
  for (int halving = 0; halving < 4; ++halving, step *= 0.5) {
    bool moved = true;
    for (int walk = 0; moved && walk < longest_walk; ++walk) {
      moved = false;
      for (const Eigen::Vector2d& way : ways) {
        const double cost = place.cost(u + step * way);
        if (!(cost < least - 1e-3)) continue;
        least = cost;
        u += step * way;
        moved = true;
      }
    }
  }
  return least;
}

/// Phase of the fastest oscillation of its cells per metre [rad/m].
double steepest_of(const OscillatingPlace& place) {
  double steepest = 0.0;
  for (const OscillatingCell& cell : place.cells) steepest = std::max(steepest, cell.wavenumber());
  return steepest;
}

/// The likelier of the optima downhill from where it is and from a start; 0 where that gains next to nothing. A start thousands of
/// periods away is that of a fit that ran off, and is not looked at: a table that reached there would fill the memory.
Eigen::Vector2d nearest_optimum(OscillatingPlace& place, Eigen::Vector2d start) {
  constexpr double next_to_nothing = 0.01;  // nats
  constexpr double farthest_phase = 1e4;    // of a start [rad]
  const double steepest = steepest_of(place);
  if (!(steepest > 0.0)) return Eigen::Vector2d::Zero();
  if (!(start.norm() * steepest < farthest_phase)) start.setZero();
  const double step = 0.5 * grid_phase / steepest;
  for (OscillatingCell& cell : place.cells) cell.tabulate(start.norm() + 6.0 * step);
  Eigen::Vector2d home = Eigen::Vector2d::Zero(), other = start;
  const double here = place.cost(home);
  const double from_other = descend(place, step, other), from_home = descend(place, step, home);
  if (!(std::min(from_home, from_other) < here - next_to_nothing)) return Eigen::Vector2d::Zero();
  return from_other < from_home ? other : home;
}

/// Where the place is likeliest, from where it is; 0 where that gains next to nothing.
Eigen::Vector2d best_move(OscillatingPlace& place, ModeSearch search) {
  const double steepest = steepest_of(place);
  double information = place.prior_information;
  for (const OscillatingCell& cell : place.cells) information += 0.5 * cell.open_information();
  if (!(steepest > 0.0)) return Eigen::Vector2d::Zero();
  const double step = grid_phase / steepest;
  const int points =
      search == ModeSearch::nearest
          ? 0
          : std::clamp(static_cast<int>(std::ceil(reach / std::sqrt(information) / step)), 1, widest);
  for (OscillatingCell& cell : place.cells) cell.tabulate(1.5 * step * (points + 2));
  Eigen::Vector2d home = Eigen::Vector2d::Zero(), best = home;
  const double here = place.cost(home);
  double least = here;
  for (int i = -points; i <= points; ++i)
    for (int j = -points; j <= points; ++j) {
      const Eigen::Vector2d u(step * i, step * j);
      const double cost = place.cost(u);
      if (!(cost < least)) continue;
      least = cost;
      best = u;
    }
  const double go = descend(place, 0.5 * step, best);
  if (!(go < here - worth)) return Eigen::Vector2d::Zero();
  if (search == ModeSearch::nearest) return best;
  return go < descend(place, 0.5 * step, home) - worth ? best : home;
}

/// Moves every place that is free by itself, with all its stops, by move_of(place, the stop that opens it). False: all stayed.
template <typename MoveOf>
bool move_places(const JointProblem& problem, JointState& state, const MoveOf& move_of) {
  std::vector<Eigen::Vector2d> moves(static_cast<std::size_t>(problem.place_count), Eigen::Vector2d::Zero());
  for (std::size_t k = 0; k < problem.stops.size(); ++k) {
    const StopPrior& prior = problem.stops[k];
    const auto p = static_cast<std::size_t>(prior.place);
    if (prior.opens_place && !prior.chained && prior.sigma_xy_m > 0.0) moves[p] = move_of(p, k);
    state.stops[k].x_m += moves[p].x();
    state.stops[k].y_m += moves[p].y();
  }
  return std::any_of(moves.begin(), moves.end(),
                     [](const Eigen::Vector2d& move) { return !move.isZero(0.0); });
}

}  // namespace

bool move_places_to_modes(const Rows& rows, const Model& model, const WorkingCells& working,
                          ModeSearch search, JointState& state) {
  const JointProblem& problem = working.problem;
  CellGeometry geometry = cell_geometry(rows, state);
  geometry.stages = working.stages;
  const OscillatingEffects oscillating = oscillating_effects(rows, model, working, geometry, nullptr);
  if (oscillating.effects.empty()) return false;
  std::vector<OscillatingPlace> places(static_cast<std::size_t>(problem.place_count));
  for (int cell = 0; cell < rows.cell_count; ++cell) {
    const int place = problem.stops[static_cast<std::size_t>(problem.cells.stop[cell])].place;
    places[static_cast<std::size_t>(place)].cells.emplace_back(rows, oscillating, working, geometry, state,
                                                               cell);
  }
  return move_places(problem, state, [&](std::size_t p, std::size_t k) -> Eigen::Vector2d {
    if (places[p].cells.empty()) return Eigen::Vector2d::Zero();
    places[p].hold(problem.stops[k], state.stops[k]);
    return best_move(places[p], search);
  });
}

bool follow_oscillation(const Rows& rows, const Model& model, const WorkingCells& working_before,
                        const JointState& before, const WorkingCells& working, const Sides* sides,
                        JointState& state) {
  constexpr double straight = 0.01;  // sum of the squares, in units of the cells' errors
  const JointProblem& problem = working.problem;
  CellGeometry geometry = cell_geometry(rows, state);
  geometry.stages = working.stages;
  std::vector<double> off(static_cast<std::size_t>(problem.place_count), 0.0);
  std::vector<std::vector<int>> cells(off.size());
  for (int c = 0; c < rows.cell_count; ++c) {
    const auto cell = static_cast<std::size_t>(c);
    const auto place =
        static_cast<std::size_t>(problem.stops[static_cast<std::size_t>(problem.cells.stop[cell])].place);
    cells[place].push_back(c);
    const double line = working_before.problem.cells.range_mean[cell] -
                        working_before.problem.cells.effect_change(cell, geometry.d[cell]);
    off[place] +=
        std::pow(problem.cells.range_mean[cell] - line, 2) * range_information(working, geometry, c);
  }
  if (std::all_of(off.begin(), off.end(), [&](double square) { return square < straight; })) return false;
  const OscillatingEffects oscillating = oscillating_effects(rows, model, working, geometry, sides);
  if (oscillating.effects.empty()) return false;
  return move_places(problem, state, [&](std::size_t p, std::size_t k) -> Eigen::Vector2d {
    if (off[p] < straight) return Eigen::Vector2d::Zero();
    OscillatingPlace place;
    for (int c : cells[p]) place.cells.emplace_back(rows, oscillating, working, geometry, state, c);
    place.hold(problem.stops[k], state.stops[k]);
    return nearest_optimum(
        place, {before.stops[k].x_m - state.stops[k].x_m, before.stops[k].y_m - state.stops[k].y_m});
  });
}

}  // namespace rangecal::diagnosis
