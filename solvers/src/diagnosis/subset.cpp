// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/subset.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <numeric>

#include "diagnosis/alternation.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal::diagnosis {
namespace {

template <typename T>
std::vector<T> taken(const std::vector<T>& values, const std::vector<int>& order) {
  std::vector<T> result;
  if (values.empty()) return result;
  result.reserve(order.size());
  for (int i : order) result.push_back(values[static_cast<std::size_t>(i)]);
  return result;
}

/// First cell of every stop, and their end, from the stops of the cells in order.
void index_stops(JointProblem& problem) {
  Cells& cells = problem.cells;
  cells.stop_begin.assign(problem.stops.size() + 1, 0);
  for (int stop : cells.stop) ++cells.stop_begin[static_cast<std::size_t>(stop) + 1];
  std::partial_sum(cells.stop_begin.begin(), cells.stop_begin.end(), cells.stop_begin.begin());
}

/// What a part keeps of things that are numbered: which, and their new numbers (-1: none).
struct Numbering {
  std::vector<int> kept, number;
  template <typename Keeps>
  Numbering(int count, const Keeps& keeps) : number(static_cast<std::size_t>(count), -1) {
    for (int i = 0; i < count; ++i) {
      if (!keeps(static_cast<std::size_t>(i))) continue;
      number[static_cast<std::size_t>(i)] = static_cast<int>(kept.size());
      kept.push_back(i);
    }
  }
  int operator()(int old) const { return number[static_cast<std::size_t>(old)]; }
};

/// The context of those stops and landmarks; what it says of all readings stays.
void keep_in_context(const Numbering& stops, const Numbering& landmarks, EffectContext& context) {
  context.stop_count = static_cast<int>(stops.kept.size());
  context.landmark_count = static_cast<int>(landmarks.kept.size());
  context.landmark_labels = taken(context.landmark_labels, landmarks.kept);
  context.landmark_radius_m = taken(context.landmark_radius_m, landmarks.kept);
  context.commanded = taken(context.commanded, stops.kept);
  context.path_m = taken(context.path_m, stops.kept);
  context.stop_time_s = taken(context.stop_time_s, stops.kept);
}

}  // namespace

Rows without_cells(const Rows& rows, const std::vector<char>& out) {
  std::vector<int> cells, kept;
  for (int c = 0; c < rows.cell_count; ++c) {
    if (out[static_cast<std::size_t>(c)]) continue;
    cells.push_back(c);
    for (int i = rows.cell_begin[c]; i < rows.cell_begin[c + 1]; ++i) kept.push_back(i);
  }
  Rows part;
  part.context = rows.context;
  part.pairs = rows.pairs;
  part.curve = rows.curve;
  part.range_min_m = rows.range_min_m;
  part.range_max_m = rows.range_max_m;
  part.alpha_prior = rows.alpha_prior;
  part.stop = taken(rows.stop, kept);
  part.landmark = taken(rows.landmark, kept);
  part.repeat = taken(rows.repeat, kept);
  part.file_row = taken(rows.file_row, kept);
  part.range_m = taken(rows.range_m, kept);
  part.bearing_rad = taken(rows.bearing_rad, kept);
  part.time_s = taken(rows.time_s, kept);
  part.radius_m = taken(rows.radius_m, kept);
  part.heading_rad = taken(rows.heading_rad, kept);
  part.block = taken(rows.block, kept);
  part.blocks = rows.blocks;
  part.sequence = rows.sequence.of(kept);
  if (!rows.rate_mps.empty()) part.rate_mps = taken(rows.rate_mps, kept);
  const std::size_t columns = rows.context.covariates.size();
  for (int i : kept)
    part.covariates.insert(part.covariates.end(),
                           rows.covariates.begin() + static_cast<std::ptrdiff_t>(i * columns),
                           rows.covariates.begin() + static_cast<std::ptrdiff_t>((i + 1) * columns));
  part.cell_count = static_cast<int>(cells.size());
  part.cell_begin.push_back(0);
  for (int c : cells) {
    const int count = rows.cell_begin[c + 1] - rows.cell_begin[c];
    part.cell.insert(part.cell.end(), static_cast<std::size_t>(count),
                     static_cast<int>(part.cell_begin.size()) - 1);
    part.cell_begin.push_back(part.cell_begin.back() + count);
  }
  part.problem = rows.problem;
  Cells& p = part.problem.cells;
  for (auto member : {&Cells::stop, &Cells::landmark}) p.*member = taken(rows.problem.cells.*member, cells);
  for (auto member :
       {&Cells::count, &Cells::range_weight, &Cells::bearing_weight, &Cells::range_mean,
        &Cells::range_mean_square, &Cells::bearing_mean, &Cells::bearing_mean_square, &Cells::radius_m})
    p.*member = taken(rows.problem.cells.*member, cells);
  index_stops(part.problem);
  part.problem.readings = std::accumulate(p.count.begin(), p.count.end(), 0.0);
  if (rows.pairs) part.nll_offset = -SilentBearing::nll(part.problem.readings);
  return part;
}

Rows of_recordings(const Rows& rows, const std::vector<char>& kept, JointState& state) {
  const auto keeps = [&](int recording) { return kept[static_cast<std::size_t>(recording)] != 0; };
  std::vector<char> out(static_cast<std::size_t>(rows.cell_count));
  for (std::size_t c = 0; c < out.size(); ++c) out[c] = !keeps(recording_of(rows, c));
  Rows part = without_cells(rows, out);
  if (rows.pairs) return part;  // every cell has a stop of its own, and the landmark is none
  const JointProblem& all = rows.problem;
  const Numbering stops(all.stop_count(), [&](std::size_t k) { return keeps(all.stops[k].recording); });
  const Numbering landmarks(all.landmark_count(),
                            [&](std::size_t l) { return keeps(all.landmark_recording[l]); });
  JointProblem& problem = part.problem;
  problem.stops = taken(all.stops, stops.kept);
  problem.sigma_s_shared = taken(all.sigma_s_shared, stops.kept);
  std::map<int, int> places;
  for (StopPrior& stop : problem.stops)
    stop.place = places.emplace(stop.place, static_cast<int>(places.size())).first->second;
  problem.place_count = static_cast<int>(places.size());
  problem.landmark_radius_m = taken(all.landmark_radius_m, landmarks.kept);
  problem.landmark_recording = taken(all.landmark_recording, landmarks.kept);
  problem.known_distances.clear();
  for (KnownDistance taped : all.known_distances) {  // both its ends are of one recording
    taped.from = landmarks(taped.from);
    taped.to = landmarks(taped.to);
    if (taped.from >= 0 && taped.to >= 0) problem.known_distances.push_back(taped);
  }
  for (std::vector<int>* column : {&problem.cells.stop, &part.stop})
    for (int& stop : *column) stop = stops(stop);
  for (std::vector<int>* column : {&problem.cells.landmark, &part.landmark})
    for (int& landmark : *column) landmark = landmarks(landmark);
  index_stops(problem);
  keep_in_context(stops, landmarks, part.context);
  state.stops = taken(state.stops, stops.kept);
  state.landmarks = taken(state.landmarks, landmarks.kept);
  return part;
}

double laplace_value(const Rows& rows, const Model& model, JointState& state) {
  constexpr int most_weighings = 30;
  constexpr double settled = 1e-2;  // nats
  double value = std::numeric_limits<double>::quiet_NaN(), before = value;
  Alternation alternation(model);
  bool again = true;
  for (int pass = 1; again; ++pass) {
    WorkingProblem working = alternation.begin(rows, model, state);
    // Under the weights that tails give where a stop was, the value is a bound, tight once the stop stays.
    const bool weighs = working.tail_shift.size() > 0 && pass < most_weighings;
    // A stop predicted from others is off by more than the stretch on which a fast effect is straight.
    working.problem.cells.effect_slope.clear();
    JointState start = state;
    for (std::size_t k = 0; k < start.stops.size(); ++k) {
      const StopPrior& prior = working.problem.stops[k];
      if (prior.sigma_heading_rad == 0.0) start.stops[k].heading_rad = prior.commanded.heading_rad;
      if (prior.sigma_xy_m == 0.0) {
        start.stops[k].x_m = prior.commanded.x_m;
        start.stops[k].y_m = prior.commanded.y_m;
      }
    }
    const LaplaceValue laplace = laplace_marginal(working.problem, start);
    if (!laplace.ok) return std::numeric_limits<double>::quiet_NaN();
    state = laplace.state;
    before = value;
    value = laplace.marginal_nll + working.constant + serial_nll(rows, working, state);
    again = alternation.another(rows, state, value) || (weighs && !(std::abs(value - before) < settled));
  }
  return value;
}

std::vector<int> folds_of(const Rows& rows, const std::vector<int>& block_of_cell, int folds) {
  const int blocks =
      block_of_cell.empty() ? 0 : 1 + *std::max_element(block_of_cell.begin(), block_of_cell.end());
  std::vector<int> order(static_cast<std::size_t>(blocks)), fold_of_block(static_cast<std::size_t>(blocks));
  std::iota(order.begin(), order.end(), 0);
  const auto hash = [](int block) { return seed_from("held out", {static_cast<std::uint64_t>(block)}); };
  std::sort(order.begin(), order.end(), [&](int a, int b) { return hash(a) < hash(b); });
  for (int rank = 0; rank < blocks; ++rank)
    fold_of_block[static_cast<std::size_t>(order[rank])] = rank % folds;
  std::vector<int> fold(block_of_cell.size());
  for (std::size_t c = 0; c < fold.size(); ++c)
    fold[c] = fold_of_block[static_cast<std::size_t>(block_of_cell[c])];
  if (rows.pairs) return fold;
  const Cells& cells = rows.problem.cells;
  for (int l = 0; l < rows.problem.landmark_count(); ++l)
    for (int f = 0; f < folds; ++f) {
      const auto left = [&](std::size_t c) { return cells.landmark[c] == l && fold[c] != f; };
      int kept = 0;
      for (std::size_t c = 0; c < fold.size(); ++c) kept += left(c);
      for (std::size_t c = 0; kept < 3 && c < fold.size(); ++c)
        if (cells.landmark[c] == l && fold[c] == f) {
          fold[c] = -1;
          ++kept;
        }
    }
  return fold;
}

std::vector<int> blocks_of_cells(const Rows& rows) {
  std::vector<int> joined(
      rows.block.empty()
          ? 0
          : static_cast<std::size_t>(1 + *std::max_element(rows.block.begin(), rows.block.end())));
  std::iota(joined.begin(), joined.end(), 0);
  const auto lowest = [&](int block) {
    while (joined[static_cast<std::size_t>(block)] != block) block = joined[static_cast<std::size_t>(block)];
    return block;
  };
  for (std::size_t i = 1; i < rows.size(); ++i) {
    if (rows.cell[i] != rows.cell[i - 1]) continue;
    const int a = lowest(rows.block[i]), b = lowest(rows.block[i - 1]);
    joined[static_cast<std::size_t>(std::max(a, b))] = std::min(a, b);
  }
  std::map<int, int> number;
  std::vector<int> block;
  for (int c = 0; c < rows.cell_count; ++c) {
    const int of_first = lowest(rows.block[static_cast<std::size_t>(rows.cell_begin[c])]);
    block.push_back(number.emplace(of_first, static_cast<int>(number.size())).first->second);
  }
  return block;
}

}  // namespace rangecal::diagnosis
