// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <bit>
#include <cmath>
#include <limits>
#include <span>
#include <tuple>
#include <utility>

#include "recursive/count_up.hpp"
#include "recursive/landmark_answer.hpp"
#include "recursive/landmark_sums.hpp"
#include "recursive/residual_sketch.hpp"

namespace rangecal {
namespace {

/// Stops without an optimum are held until there are so many blocks of them; then they are left out.
constexpr int most_blocks = 4;

/// So many stops are kept as they came beside their sums; the last block may go beyond.
constexpr int most_past = 256;

JointProblem with_first_exact(JointProblem problem) {
  problem.stops[0].sigma_xy_m = problem.stops[0].sigma_heading_rad = 0.0;
  problem.stops[0].shape.reset();
  return problem;
}

/// About the sigmas of an answer, as wide as they may move.
SigmaGrid grid_about(const Eigen::Vector2d& log_sigmas, const Eigen::MatrixXd& covariance) {
  SigmaGrid grid;
  grid.centre = log_sigmas;
  grid.half_width = std::clamp(6.0 * std::sqrt(covariance.diagonal().tail<2>().maxCoeff()), 0.3, 0.6);
  return grid;
}

/// The stops of `from` behind those of `to`, at places of their own; the landmarks are those of `from`.
void append_stops(const JointProblem& from, JointProblem& to) {
  const int stops = to.stop_count(), cells = static_cast<int>(to.cells.size());
  for (StopPrior stop : from.stops) {
    stop.place += to.place_count;
    to.stops.push_back(std::move(stop));
  }
  to.place_count += from.place_count;
  to.sigma_s_shared.resize(to.stops.size(), 0);
  to.landmark_radius_m = from.landmark_radius_m;
  to.landmark_recording = from.landmark_recording;
  to.readings += from.readings;
  to.rows_alike = from.rows_alike;
  const auto add = [&](auto Cells::*column) {
    auto& all = to.cells.*column;
    all.insert(all.end(), (from.cells.*column).begin(), (from.cells.*column).end());
  };
  add(&Cells::landmark);
  for (const auto column :
       {&Cells::count, &Cells::range_weight, &Cells::bearing_weight, &Cells::range_mean,
        &Cells::range_mean_square, &Cells::bearing_mean, &Cells::bearing_mean_square, &Cells::radius_m})
    add(column);
  for (const int stop : from.cells.stop) to.cells.stop.push_back(stop + stops);
  if (to.cells.stop_begin.empty()) to.cells.stop_begin = {0};
  for (std::size_t k = 1; k < from.cells.stop_begin.size(); ++k)
    to.cells.stop_begin.push_back(from.cells.stop_begin[k] + cells);
}

void add_to_corner(const Eigen::MatrixXd& part, Eigen::MatrixXd& whole) {
  if (part.rows() > whole.rows()) {
    const Eigen::MatrixXd before = whole;
    whole = Eigen::MatrixXd::Zero(part.rows(), part.cols());
    whole.topLeftCorner(before.rows(), before.cols()) = before;
  }
  whole.topLeftCorner(part.rows(), part.cols()) += part;
}

}  // namespace

using Eigen::MatrixXd;

void RecursiveLandmarks::sum_up() {
  tried_at_ = own_stops();
  if (!sum_up_held() && own_stops() >= most_blocks * options_.block) drop_held();
}

/// False where the stops held have no optimum, or none of them has a reading.
bool RecursiveLandmarks::sum_up_held() {
  Answer found = answer(options_.columns() - 1);
  if (sums_ && !found.settled() && sum_up_anew()) found = answer(options_.columns() - 1);
  std::optional<LandmarkSums> block;
  if (found.outcome == Outcome::converged && sums_) {
    block = std::move(found.held);
  } else if (found.outcome == Outcome::converged) {
    JointProblem cells = held_cells(found.state, found.shapes);
    if (options_.random_walk) cells = with_first_exact(std::move(cells));
    block = expand_stops(cells, found.state, grid_about(found.log_sigmas, *found.covariance),
                         phi_of(found.state));
    if (block && found.shapes) found.gap = gap_of(cells, found.state, *found.shapes);
  }
  if (!block) return false;
  bool changed = false;  // a channel's noise was Gaussian so far
  const double stops = own_stops(), kept = std::exp(-stops / options_.forget);
  if (sums_) {
    const auto take = [&](LandmarkSums& sums, double factor) {
      sums.grow(block->reference);
      if (factor < 1.0) sums.scale(factor);
      sums.add(*block);
      sums.follow(found.log_sigmas);
    };
    take(*sums_, kept);
    if (squared_) take(*squared_, kept * kept);
    range_residuals_->scale(kept);
    bearing_residuals_->scale(kept);
    gap_ *= kept;
    squared_gap_ *= kept * kept;
  } else {
    sums_ = std::make_unique<LandmarkSums>(std::move(*block));
    if (std::isfinite(options_.forget)) squared_ = std::make_unique<LandmarkSums>(*sums_);
    if (!options_.random_walk && !squared_) past_ = std::make_unique<JointProblem>();
  }
  sum_w_ = kept * sum_w_ + stops;
  sum_w_sq_ = kept * kept * sum_w_sq_ + stops;
  std::tie(low_m_, high_m_) = distances_of(held_, found.state, low_m_, high_m_);
  if (looks_for_outliers()) {
    const auto families = [](const std::optional<RobustShapes>& shapes) {
      return shapes ? std::pair(shapes->range.shape, shapes->bearing.shape)
                    : std::pair(NoiseShape::gaussian, NoiseShape::gaussian);
    };
    changed = families(shapes_) != families(found.shapes);
    for (MatrixXd* gap : {&gap_, &squared_gap_}) add_to_corner(found.gap, *gap);
    take_residuals(held_, found.state);
    outliers_ += found.outliers;
    shapes_ = found.shapes;
    renew_shapes();
  }
  last_ = found.state;
  last_->stops.clear();
  if (past_) append_stops(held_, *past_);
  options_.random_walk ? hold_last_pose() : clear_held();
  if (past_ && changed) sum_up_anew();  // what was taken for Gaussian, too
  if (past_) grow_past();
  return true;
}

void RecursiveLandmarks::take_residuals(const JointProblem& rows, const JointState& state) {
  const auto [range, bearing] = residuals_of(rows, state);
  for (std::size_t i = 0; i < range.z.size(); ++i) {
    range_residuals_->add(range.z[i], range.s[i], rows.cells.count[i]);
    bearing_residuals_->add(bearing.z[i], bearing.s[i], rows.cells.count[i]);
  }
}

/// The shapes at all residuals that were summed up; the scales stay the sums' own. Families are chosen anew as often as the
/// blocks have doubled.
void RecursiveLandmarks::renew_shapes() {
  if (!shapes_) return;
  const bool chooses = std::has_single_bit(static_cast<std::uint64_t>(stops_ / options_.block));
  const auto renew = [&](const ResidualSketch& sketch, std::span<const NoiseShape> families,
                         NoiseShapeParameters& shape) {
    ChannelResiduals residuals;
    sketch.append_to(residuals);
    if (chooses) shape = shape_beside(shape, residuals, families);
    ResidualShape start;
    start.shape = shape;
    if (!chooses && shape.shape != NoiseShape::gaussian) shape = fit_residual_shape(residuals, start).shape;
  };
  renew(*range_residuals_, range_shapes(), shapes_->range);
  renew(*bearing_residuals_, bearing_shapes(), shapes_->bearing);
  if (ChannelShapes(shapes_->range.shape, shapes_->bearing.shape).gaussian()) shapes_.reset();
}

/// Expansions about what a few stops told are good near it alone, where the readings have an error that the model lacks
/// the answer goes further: the stops there are by then are expanded anew each time that they have doubled.
void RecursiveLandmarks::grow_past() {
  const int stops = past_->stop_count();
  if (anew_stops_ == 0) anew_stops_ = stops;
  if (stops >= 2 * anew_stops_ || stops >= most_past) {
    anew_stops_ = stops;
    sum_up_anew();
  }
  if (stops >= most_past) past_.reset();
}

/// The sums of all stops that are kept as they came, about the answer of these and of the stops held by `marginal`
/// itself. False, and nothing is changed, where they are not kept or have none.
bool RecursiveLandmarks::sum_up_anew() {
  if (!past_ || past_->stops.empty()) return false;
  JointProblem all = *past_;
  append_stops(held_, all);
  Answer found = first_answer(all, options_.columns() - 1);
  if (found.outcome != Outcome::converged || !found.covariance) return false;
  JointState of_past = found.state;
  of_past.stops.resize(past_->stops.size());
  JointProblem cells = *past_;
  if (looks_for_outliers())
    cells = found.shapes ? weighted_problem(*past_, of_past, found.shapes->range, found.shapes->bearing)
                         : merge_rows(*past_);
  found.state.stops.resize(past_->stops.size());
  found.state.landmarks.resize(
      past_->landmark_radius_m.size());  // those that the stops held alone see come later
  std::optional<LandmarkSums> sums =
      expand_stops(cells, found.state, grid_about(found.log_sigmas, *found.covariance), phi_of(found.state));
  if (!sums) return false;
  *sums_ = std::move(*sums);
  if (looks_for_outliers()) {
    range_residuals_->clear();
    bearing_residuals_->clear();
    take_residuals(*past_, of_past);
    shapes_ = found.shapes;
    gap_ = shapes_ ? gap_of(cells, of_past, *shapes_) : MatrixXd();
    squared_gap_ = gap_;
    outliers_ = shapes_ ? outliers_among(*past_, of_past, *shapes_) : 0;
  }
  std::tie(low_m_, high_m_) = distances_of(*past_, found.state, std::numeric_limits<double>::infinity(), 0.0);
  last_ = found.state;
  last_->stops.clear();
  return true;
}

void RecursiveLandmarks::drop_held() {
  const int readings = static_cast<int>(std::min(held_.readings, 2e9));
  if (readings > 0) count_up(counts_.dropped["at stops without an optimum"], readings);
  counts_.used = std::max(0, counts_.used - readings);
  stops_left_out_ += own_stops();
  // landmarks that only these stops saw are forgotten with them
  const std::size_t known = sums_ ? last_->landmarks.size() : 0;
  labels_.resize(known);
  bearings_.resize(known);
  held_.landmark_radius_m.resize(known);
  held_.landmark_recording.resize(known);
  std::optional<LandmarkSums> steps;
  if (anchored_) {  // the steps were made all the same
    held_.cells = Cells{};
    held_.cells.stop_begin.assign(held_.stops.size() + 1, 0);
    held_.readings = 0.0;
    JointState state = start_of_held();
    steps = expand_stops(held_, state, sums_->grid, sums_->reference, &*sums_->last_pose);
  }
  if (!steps) return clear_held();
  sums_->last_pose = std::move(steps->last_pose);
  hold_last_pose();
}

}  // namespace rangecal
