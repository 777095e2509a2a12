// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/pairs_design.hpp"

#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>
#include <numeric>
#include <optional>
#include <stdexcept>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr double warm_s = 2700.0;       ///< 45 min
constexpr double warmer_c = 10.0;       ///< [K]
constexpr double one_way_rad = 1.2;     ///< wider than any lens that images depth
constexpr std::size_t most_gaps = 100;  ///< more distances than that leave no gaps to fill
constexpr const char* temperature_name = "temperature_c";

bool knows_directions(const Rows& rows) {
  return std::any_of(rows.bearing_rad.begin(), rows.bearing_rad.end(), [](double b) { return b != 0.0; });
}

/// The first covariate that is a temperature; none where no column is.
std::optional<std::size_t> temperature_column(const Rows& rows) {
  const EffectContext& context = rows.context;
  for (std::size_t c = 0; c < context.covariates.size(); ++c)
    if (context.covariates[c] == temperature_name ||
        (c < context.columns.size() && context.columns[c].role == ColumnRole::temperature))
      return c;
  return std::nullopt;
}

/// Words for a column that the change takes.
std::string taking_column(const char* column, bool is_there) {
  return is_there ? "" : fmt::format(" (with a column {}, which this recording lacks)", column);
}

/// The known distance of every cell [m].
std::vector<double> distances_of(const Rows& rows) {
  std::vector<double> d;
  for (int stop : rows.problem.cells.stop)
    d.push_back(rows.curve.scale.distance(
        std::abs(rows.problem.stops[static_cast<std::size_t>(stop)].commanded.x_m)));
  return d;
}

/// One cell for each distance, nearest first.
std::vector<int> cells_by_distance(const std::vector<double>& d) {
  std::vector<int> cells(d.size());
  std::iota(cells.begin(), cells.end(), 0);
  const auto at = [&](int cell) { return d[static_cast<std::size_t>(cell)]; };
  std::stable_sort(cells.begin(), cells.end(), [&](int a, int b) { return at(a) < at(b); });
  cells.erase(std::unique(cells.begin(), cells.end(), [&](int a, int b) { return at(a) == at(b); }),
              cells.end());
  return cells;
}

/// Nearer than all there are, where the sensor reads.
std::vector<double> near_distances(const Rows& rows, double nearest) {
  std::vector<double> near{0.3, 0.4, 0.5, 0.6};
  std::erase_if(near, [&](double d) { return d > 0.95 * nearest || d < rows.range_min_m; });
  return near;
}

/// Beyond all there are, where the sensor reads: by a tenth, a fifth and three tenths, or three steps to its limit.
std::vector<double> far_distances(const Rows& rows, double farthest) {
  const double end = std::min(1.3 * farthest, 0.98 * rows.range_max_m);
  if (end < 1.05 * farthest) return {};
  std::vector<double> far;
  for (int step = 1; step <= 3; ++step) far.push_back(farthest + (end - farthest) * step / 3.0);
  return far;
}

/// Fractional part of k times an irrational number: spread evenly over (0, 1) however many k are taken.
double spread_over_one(int k, double irrational) {
  const double x = k * irrational;
  return x - std::floor(x);
}

/// In an order that follows neither distance nor time.
std::vector<int> scattered(int count) {
  std::vector<int> order(static_cast<std::size_t>(count));
  std::iota(order.begin(), order.end(), 0);
  std::sort(order.begin(), order.end(), [](int a, int b) {
    return spread_over_one(a, std::numbers::phi) < spread_over_one(b, std::numbers::phi);
  });
  return order;
}

/// Between two distances, from a fifth to four fifths of the way: half-way between steps of one length a period of one
/// step looks like none.
double uneven_between(double from, double to, int gap) {
  return from + (0.2 + 0.6 * spread_over_one(gap, std::numbers::sqrt2)) * (to - from);
}

/// The readings that a change brings.
class MorePairs {
 public:
  MorePairs(const Rows& rows, DraftDesign& draft)
      : clock(rows.context.duration_s + draft.period_s),
        rows_(rows),
        draft_(draft),
        known_m_(distances_of(rows)) {}

  /// A batch at `true_m` with the target, direction and covariates of a cell, as many readings as that has or
  /// `count`, one after the other.
  void visit(int like, double true_m, int count = 0) {
    const double u = rows_.curve.scale.of(true_m);
    if (evaluate_derivative(draft_.state.alpha, u) == 0.0 ||
        !(evaluate_polynomial(draft_.state.alpha, u) > 0.0))
      return;
    const int begin = rows_.cell_begin[static_cast<std::size_t>(like)];
    const int size = rows_.cell_begin[static_cast<std::size_t>(like) + 1] - begin;
    for (int j = 0; j < (count > 0 ? count : size); ++j) {
      add(static_cast<std::size_t>(begin + j % size), true_m, clock);
      clock += draft_.period_s;
    }
    ++draft_.batches;
  }
  void visit(int cell) { visit(cell, known_m_[static_cast<std::size_t>(cell)]); }

  /// All readings once more in their order, each `shift_s` after its own time.
  void all_again(double shift_s) {
    for (std::size_t i = 0; i < rows_.size(); ++i)
      add(i, known_m_[static_cast<std::size_t>(rows_.cell[i])], rows_.time_s[i] + shift_s,
          draft_.batches + rows_.cell[i]);
    draft_.batches += rows_.cell_count;
  }
  /// The same after the end.
  void all_again() {
    all_again(clock);
    clock += rows_.context.duration_s + draft_.period_s;
  }

  double clock;  ///< [s]
  double turned_rad = 0.0;
  int targets = 1, next_target = 0;  ///< each target's place is taken by that many after it
  int warmer_column = -1;            ///< the covariate that rises

 private:
  void add(std::size_t row, double true_m, double time_s) { add(row, true_m, time_s, draft_.batches); }
  void add(std::size_t row, double true_m, double time_s, int batch) {
    const std::size_t columns = rows_.context.covariates.size();
    const auto begin = rows_.covariates.begin() + static_cast<std::ptrdiff_t>(row * columns);
    std::vector<double> covariates(begin, begin + static_cast<std::ptrdiff_t>(columns));
    if (warmer_column >= 0) covariates[static_cast<std::size_t>(warmer_column)] += warmer_c;
    const PairAt at{true_m, (rows_.landmark[row] + next_target) % std::max(1, targets),
                    wrap_angle(rows_.bearing_rad[row] + turned_rad)};
    draft_.add_pair(batch, at, time_s, covariates.data(), rows_);
  }

  const Rows& rows_;
  DraftDesign& draft_;
  std::vector<double> known_m_;  ///< of every cell
};

}  // namespace

std::vector<MenuEntry> menu_for_pairs(const Rows& rows) {
  const std::vector<double> d = distances_of(rows);
  const std::vector<int> cells = cells_by_distance(d);
  const double nearest = d[static_cast<std::size_t>(cells.front())];
  const double farthest = d[static_cast<std::size_t>(cells.back())];
  const bool times = rows.context.duration_s > 0.0, directions = knows_directions(rows);
  const bool one_way = directions && rows.context.largest_bearing_rad < one_way_rad;
  std::vector<MenuEntry> menu;
  const auto offer = [&menu](const char* code, std::string change) {
    menu.push_back({code, std::move(change)});
  };
  if (cells.size() >= 3)
    offer("random order",
          "read the same distances once more in random order" + taking_column("time_s", times));
  if (times && cells.size() >= 3)
    offer("cold start", "let the sensor cool down, then record the same distances in random order");
  offer("E7", "take 200 readings at one near, one middle and one far distance");
  offer("E8", "move the target at the middle distance by 5 mm, five times");
  offer("E10", "read all distances again with the lights off or the window covered");
  offer("finer readings", "record the readings with more digits");
  if (times) offer("E12", "leave the sensor on for 45 minutes, then repeat the first distance");
  if (cells.size() >= 2 && cells.size() <= most_gaps)
    offer("denser", "read also between neighbouring distances, at uneven steps and in random order");
  if (const std::vector<double> near = near_distances(rows, nearest); !near.empty())
    offer("E9", near.size() > 1 ? fmt::format("read also at {:g} to {:g} m", near.front(), near.back())
                                : fmt::format("read also at {:g} m", near.front()));
  if (const std::vector<double> far = far_distances(rows, farthest); !far.empty())
    offer("farther", fmt::format("read also beyond the far end, to {:.1f} m", far.back()));
  offer("another day", "read all distances again on another day, as batches of their own");
  if (rows.context.landmark_count >= 2)
    offer("E6", "exchange the targets and read all distances again");
  else
    offer("E6", "read all distances again with a target of another reflectance" +
                    taking_column("landmark", rows.context.landmark_count > 0));
  offer("warmer", "read all distances again 10 degrees warmer" +
                      taking_column(temperature_name, temperature_column(rows).has_value()));
  offer("E1", one_way ? "turn the sensor to either side at each distance"
                      : "turn the sensor by 90, 180 and 270 degrees at each distance" +
                            taking_column("bearing_rad", directions));
  return menu;
}

void extend_pairs(const Rows& rows, const std::string& code, DraftDesign& draft, ExtendedDesign& design) {
  const std::vector<double> d = distances_of(rows);
  const std::vector<int> cells = cells_by_distance(d);
  const int middle = cells[cells.size() / 2];
  const auto at = [&d](int cell) { return d[static_cast<std::size_t>(cell)]; };
  MorePairs more(rows, draft);
  if (code == "random order" || code == "cold start") {
    design.adds_times = !(rows.context.duration_s > 0.0);
    if (design.adds_times) {
      draft.recording.pairs = Pairs{};
      for (const std::string& name : rows.context.covariates) draft.recording.pairs.covariates[name];
    }
    if (design.adds_times || code == "cold start") more.clock = 0.0;  // a recording of its own
    for (int cell : scattered(rows.cell_count)) more.visit(cell);
  } else if (code == "E7") {
    for (int cell : {cells.front(), middle, cells.back()}) more.visit(cell, at(cell), 200);
  } else if (code == "E8") {
    for (int step = 1; step <= 5; ++step) more.visit(middle, at(middle) + 0.005 * step);
  } else if (code == "E10") {
    design.switched_off = effects_without(code);
    design.first_new_stop = rows.cell_count;
    more.all_again();
  } else if (code == "finer readings") {
    design.switched_off = effects_without(code);
  } else if (code == "E12") {
    const auto first = std::min_element(rows.time_s.begin(), rows.time_s.end());
    more.clock = rows.context.duration_s + warm_s;
    more.visit(rows.cell[static_cast<std::size_t>(first - rows.time_s.begin())]);
  } else if (code == "denser") {
    for (int gap : scattered(static_cast<int>(cells.size()) - 1)) {
      const int from = cells[static_cast<std::size_t>(gap)], to = cells[static_cast<std::size_t>(gap) + 1];
      more.visit(to, uneven_between(at(from), at(to), gap));
    }
  } else if (code == "E9") {
    for (double near : near_distances(rows, at(cells.front()))) more.visit(cells.front(), near);
  } else if (code == "farther") {
    for (double far : far_distances(rows, at(cells.back()))) more.visit(cells.back(), far);
  } else if (code == "another day") {
    more.all_again(0.0);
  } else if (code == "E6") {
    more.targets = std::max(2, rows.context.landmark_count);
    more.next_target = 1;
    while (static_cast<int>(draft.recording.landmarks.size()) < more.targets)
      draft.recording.landmarks.push_back({std::to_string(draft.recording.landmarks.size()), 0.0, {}});
    more.all_again();
  } else if (code == "warmer") {
    const std::optional<std::size_t> column = temperature_column(rows);
    design.varies = column ? rows.context.covariates[*column] : temperature_name;
    const std::size_t before = rows.size();
    if (column) more.warmer_column = static_cast<int>(*column);
    more.all_again(0.0);
    if (!column) {  // of a temperature that nobody wrote down the difference is known
      std::vector<double>& added = draft.recording.pairs.covariates[temperature_name];
      added.assign(before, 20.0);
      added.resize(2 * before, 20.0 + warmer_c);
    }
  } else if (code == "E1") {
    const double widest = rows.context.largest_bearing_rad;
    const bool one_way = knows_directions(rows) && widest < one_way_rad;
    for (double turn : one_way
                           ? std::vector{-0.5 * widest, 0.5 * widest}
                           : std::vector{0.5 * std::numbers::pi, std::numbers::pi, -0.5 * std::numbers::pi}) {
      more.turned_rad = turn;
      more.all_again();
    }
  } else {
    throw std::invalid_argument("no experiment is called '" + code + "'");
  }
}

}  // namespace rangecal::diagnosis
