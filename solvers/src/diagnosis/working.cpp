// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/working.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "diagnosis/alternation.hpp"
#include "diagnosis/wandering_part.hpp"
#include "rangecal/core/angles.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal::diagnosis {
namespace {

/// How the commanded poses of `to` differ from those of `from`.
std::vector<Eigen::Vector3d> moves_between(const std::vector<StopPrior>& from,
                                           const std::vector<StopPrior>& to) {
  std::vector<Eigen::Vector3d> moves(from.size());
  for (std::size_t k = 0; k < from.size(); ++k)
    moves[k] = {to[k].commanded.x_m - from[k].commanded.x_m, to[k].commanded.y_m - from[k].commanded.y_m,
                to[k].commanded.heading_rad - from[k].commanded.heading_rad};
  return moves;
}

void add(const Signature& part, Signature& x) {
  x.range += part.range;
  x.bearing += part.bearing;
  x.drift += part.drift;
}

/// Slope in d of what the model's effects add to the range of a cell, read at its first row.
double effect_slope_of_cell(const Rows& rows, const CellGeometry& geometry, const Model& model,
                            const Sides* sides, int cell) {
  const ReadingView<double> here = view_of(rows, geometry, static_cast<std::size_t>(rows.cell_begin[cell]));
  double effect_slope = 0.0;
  for (std::size_t e = 0; e < model.size(); ++e)
    effect_slope += geometry.stages.gain(model[e].effect->info().stage, cell) *
                    effect_slope_of(model[e], sides ? sides->seen_by(e, cell, here) : here);
  return effect_slope;
}

/// Weight and mean square of a cell whose readings share a variance of s^2 `ratio`, such that
///   n log s + weight ((mean - mu)^2 + mean square) / (2 s^2)
/// and what is added to `constant` is the exact NLL of the white readings. `extra_square`: sum of squares [m^2] that tails
/// add to those of the deviations.
void set_weight(const CellsAndRows& parts, int cell, double ratio, double extra_square, const Rows& rows,
                double& weight, double& mean_square, double& constant) {
  const int begin = rows.cell_begin[cell], count = rows.cell_begin[cell + 1] - begin;
  const double shared = parts.weights[cell] * ratio;
  weight = parts.weights[cell] / (1.0 + shared);
  mean_square = (parts.deviations.segment(begin, count).squaredNorm() + extra_square) / weight;
  constant += 0.5 * std::log1p(shared);
}

/// The likeliest error c that the readings of a cell share beside errors of their own, e_i = c + own, c ~ N(0, sigma^2): from the median
/// to where
///
///   g(c) = d/dc (sum_i ln p_i((e_i - c) / s_i) - c^2 / (2 sigma^2)) = 0.
///
/// A step is Newton's where the sum is concave and |g| is smaller behind it, else that of the Gaussians that stand for the laws, which
/// always gains (expectation and maximisation). `law(i, e, slopes)`: the log density of reading i at the error e, as TailLaw::density.
template <typename Law>
double likeliest_shared_error(const std::vector<double>& errors, const std::vector<double>& spreads,
                              double sigma, const Law& law) {
  constexpr int most = 30;
  struct Point {
    double c, slope = 0.0, curvature, information;
  };
  const auto at = [&](double c) {
    Point point{.c = c,
                .slope = -c / (sigma * sigma),
                .curvature = 1.0 / (sigma * sigma),
                .information = 1.0 / (sigma * sigma)};
    for (std::size_t i = 0; i < errors.size(); ++i) {
      TailLaw::Slopes slopes;
      const LogDensity of_row = law(i, errors[i] - c, slopes);
      point.slope -= of_row.derivative / spreads[i];
      point.curvature += slopes.curvature / (spreads[i] * spreads[i]);
      point.information += of_row.weight / (spreads[i] * spreads[i]);
    }
    return point;
  };
  Point here = at(upper_median(errors));
  for (int iteration = 0; iteration < most; ++iteration) {
    const bool concave = here.curvature > 0.0;
    const double always_gains = here.slope / here.information;
    const double step = concave ? here.slope / here.curvature : always_gains;
    if (!(std::abs(step) > 1e-6 * spreads[0])) return here.c + step;
    Point next = at(here.c + step);
    if (concave && !(std::abs(next.slope) < std::abs(here.slope))) next = at(here.c + always_gains);
    here = next;
  }
  return here.c;
}

/// Puts in the place of the law of a row's error the Gaussian that stands for it there; `constant` takes what the NLL has more.
void put_gaussian(const LogDensity& at, double error, double spread, Eigen::Index row,
                  Eigen::ArrayXd& range_m, WorkingProblem& working) {
  const double off = error / spread - at.shift;
  working.constant += 0.5 * std::log(at.weight) - half_log_two_pi - at.value -
                      0.5 * (at.weight * off * off + at.extra_square);
  working.range[row] -= at.shift * spread;
  range_m[row] /= at.weight;
  working.tail_shift[row] = at.shift * spread;
  working.tail_square[row] = at.extra_square;
}

/// The Gaussian that stands for the law of every row's error at its residual (expectation and maximisation): shifts `range` and divides the
/// variance by its weight.
void add_tails(const Rows& rows, const CellGeometry& geometry, const Model& model, const RowChanges& changes,
               double cell_sigma_m, Eigen::ArrayXd& range_m, WorkingProblem& working) {
  TailLaws laws(rows, geometry, model);
  const Eigen::Index n = working.range.size();
  if (cell_sigma_m > 0.0) {
    working.tail_centre.setZero(n);
    for (int c = 0; c < rows.cell_count; ++c) {
      const auto cell = static_cast<std::size_t>(c);
      const int begin = rows.cell_begin[cell], count = rows.cell_begin[cell + 1] - begin;
      std::vector<double> errors, spreads;
      std::vector<TailLaw> of_rows;
      for (int i = begin; i < begin + count; ++i) {
        errors.push_back(working.range[i] - geometry.f[cell]);
        spreads.push_back(geometry.spread[cell] * std::sqrt(range_m[i]));
        of_rows.push_back(laws.of(static_cast<std::size_t>(i)));
      }
      const auto law = [&](std::size_t i, double error, TailLaw::Slopes& slopes) {
        return of_rows[i].density(error, spreads[i], &slopes);
      };
      working.tail_centre.segment(begin, count)
          .setConstant(likeliest_shared_error(errors, spreads, cell_sigma_m, law));
    }
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    const TailLaw& tails = laws.of(static_cast<std::size_t>(i));
    if (tails.empty()) continue;
    const auto cell = static_cast<std::size_t>(rows.cell[static_cast<std::size_t>(i)]);
    const double spread = geometry.spread[cell] * std::sqrt(range_m[i]),
                 error = working.range_of_tail(i) - geometry.f[cell];
    if (working.tail_shift.size() == 0) {
      working.tail_shift.setZero(n);
      working.tail_square.setZero(n);
      working.range_log_variance = changes.range_log_variance;
    }
    put_gaussian(tails.density(error, spread), error, spread, i, range_m, working);
  }
}

/// The same along a sequence, where the law is that of a row's error less what the rows before it predict.
void add_tails_along(const Rows& rows, const CellGeometry& geometry, const Model& model,
                     const RowChanges& changes, const Dependence& dependence, Eigen::ArrayXd& range_m,
                     WorkingProblem& working) {
  const Eigen::Index n = working.range.size();
  for (Eigen::VectorXd* column :
       {&working.tail_shift, &working.tail_square, &working.tail_centre, &working.prediction_spread})
    column->resize(n);
  working.range_log_variance = changes.range_log_variance;
  Eigen::VectorXd weight(n), curvature(n);
  const double q = dependence.range_correlated_share, rho = dependence.range_correlation;
  TailLaws laws(rows, geometry, model);
  WanderingPart part(rows.sequence, q, rho);
  for (const int row : rows.sequence.order) {
    const auto i = static_cast<std::size_t>(row);
    const auto cell = static_cast<std::size_t>(rows.cell[i]);
    const WanderingPart::Prediction before = part.before(row);
    const double spread = geometry.spread[cell] * std::sqrt(range_m[row]), own = spread * before.spread(),
                 centre = spread * before.mean, error = working.range[row] - geometry.f[cell] - centre;
    TailLaw::Slopes slopes;
    const LogDensity at = laws.of(i).density(error, own, &slopes);
    const auto [mean, variance] = before.behind(at.derivative, slopes.curvature);
    part.leave(row, mean, variance);
    put_gaussian(at, error, own, row, range_m, working);
    working.tail_centre[row] = centre;
    working.prediction_spread[row] = before.spread();
    weight[row] = at.weight;
    curvature[row] = slopes.curvature;
  }
  working.serial = SerialErrors(rows.sequence, q, rho, weight, curvature);
}

/// Readings whose variances are m times the spread's squares.
Whitening whitening_of(const Eigen::ArrayXd& m, double rho) {
  return {(m == 1.0).all() ? Eigen::VectorXd() : Eigen::VectorXd(m.rsqrt()), rho};
}

/// What the repeats of a cell share: an error of that standard deviation, and the grid's part.
double shared_variance(double sigma, const std::vector<RoundingVariance>& grid, int cell) {
  return sigma * sigma + (grid.empty() ? 0.0 : grid[static_cast<std::size_t>(cell)].shared);
}

}  // namespace

void set_effect_slopes(const Rows& rows, const CellGeometry& geometry, const Model& model, const Sides* sides,
                       Cells& cells) {
  constexpr double slow = 0.02;
  std::vector<double> effect_slope(static_cast<std::size_t>(rows.cell_count));
  double steepest = 0.0;
  for (int c = 0; c < rows.cell_count; ++c) {
    effect_slope[c] = effect_slope_of_cell(rows, geometry, model, sides, c);
    steepest = std::max(steepest, std::abs(effect_slope[c]));
  }
  if (!(steepest > slow)) return;
  cells.effect_slope = std::move(effect_slope);
  cells.effect_slope_at_m = geometry.d;
}

double effect_slope_of(const ActiveEffect& active, const ReadingView<double>& at) {
  if (active.effect->info().kind != EffectKind::mean || !active.effect->changes_with_distance()) return 0.0;
  const double step = distance_step(at.d), jump = active.effect->switching_distance(active.parameters.data());
  const bool beside = std::abs(jump - at.d) <= 2.0 * step;
  const double below = beside && jump <= at.d ? 0.0 : step, above = beside && jump > at.d ? 0.0 : step;
  const auto range_at = [&](double h) {
    return active.effect->reading(moved_by(at, h), active.parameters.data()).range;
  };
  return (range_at(above) - range_at(-below)) / (above + below);
}

bool is_tail(const ActiveEffect& active) { return active.effect->info().kind == EffectKind::tail; }

bool has_tails(const Model& model) { return std::any_of(model.begin(), model.end(), is_tail); }

TailLaws::TailLaws(const Rows& rows, const CellGeometry& geometry, const Model& model)
    : rows_(rows), geometry_(geometry), model_(model) {
  for (std::size_t e = 0; e < model.size(); ++e)
    if (is_tail(model[e])) tails_.push_back(static_cast<int>(e));
}

const TailLaw& TailLaws::of(std::size_t row) {
  if (tails_.empty()) return law_;
  bool same_shares = !parts_.empty();
  parts_.resize(tails_.size());
  const ReadingView<double> view = view_of(rows_, geometry_, row);
  for (std::size_t k = 0; k < tails_.size(); ++k) {
    const ActiveEffect& active = model_[static_cast<std::size_t>(tails_[k])];
    const Contamination part = active.effect->contamination(view, active.parameters.data());
    same_shares = same_shares && part.share == parts_[k].share;
    parts_[k] = part;
  }
  if (same_shares) {
    for (std::size_t k = 0, share = 0; k < tails_.size() && share < effect_of_share_.size(); ++k)
      if (parts_[k].share > 0.0) law_.resize(share++, parts_[k]);
    return law_;
  }
  law_ = TailLaw();
  effect_of_share_.clear();
  for (std::size_t k = 0; k < tails_.size(); ++k)
    if (law_.add(parts_[k])) effect_of_share_.push_back(tails_[k]);
  return law_;
}

TailLaw tail_law_of(const Rows& rows, const CellGeometry& geometry, const Model& model, std::size_t row) {
  return TailLaws(rows, geometry, model).of(row);
}

SerialErrors serial_errors_of(const Rows& rows, const Model& model) {
  const Dependence dependence = dependence_of(model);
  return SerialErrors(rows.sequence, dependence.range_correlated_share, dependence.range_correlation);
}

std::vector<StopPrior> commanded_under(const Rows& rows, const Model& model) {
  std::vector<StopPrior> stops = rows.problem.stops;
  for (const ActiveEffect& active : model)
    if (active.effect->acts_on_stops()) active.effect->stops(rows.context, active.parameters.data(), stops);
  return stops;
}

WorkingProblem working_problem(const Rows& rows, const Model& model, const JointState& state,
                               const Sides* sides) {
  WorkingProblem working;
  working.problem = rows.problem;
  working.constant = rows.nll_offset;
  CellGeometry geometry = cell_geometry(rows, state);
  geometry.stages = working.stages = stages_of(rows, geometry, model);
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  working.range = Eigen::Map<const Eigen::VectorXd>(rows.range_m.data(), n);
  working.bearing.setZero(n);
  if (model.empty()) {
    if (rows.reads_bearings())
      for (Eigen::Index i = 0; i < n; ++i)
        working.bearing[i] = wrap_angle(rows.bearing_rad[i] - geometry.bearing[rows.cell[i]]);
    working.range_deviation = split(rows, working.range, {}).deviations;
    working.bearing_deviation = split(rows, working.bearing, {}).deviations;
    return working;
  }
  const RowChanges changes = row_changes(rows, geometry, model, sides);
  const Dependence dependence = dependence_of(model);
  const bool reciprocal = has_reciprocal_noise(model);
  working.problem.stops = commanded_under(rows, model);
  Cells& c = working.problem.cells;
  if (!rows.pairs) set_effect_slopes(rows, geometry, model, sides, c);
  // m of every row: what the effects do to its variance, and the weight of a tail at its residual.
  Eigen::ArrayXd range_m = changes.range_log_variance.array().exp(),
                 bearing_m = changes.bearing_log_variance.array().exp();
  if (!changes.rounding.range.empty() && rows.cell_count == n) {
    working.rounding_share.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto cell = static_cast<std::size_t>(rows.cell[static_cast<std::size_t>(i)]);
      working.rounding_share[i] =
          changes.rounding.range[cell].own / (std::pow(geometry.spread[cell], 2) * range_m[i]);
    }
  }
  for (Eigen::Index i = 0; i < n; ++i) {
    const int cell = rows.cell[i];
    const double f = geometry.f[cell];
    double& range = working.range[i];
    range -= changes.range[i];
    if (reciprocal && range > 0.0) {  // 1/y ~ N(1/f, (s/f^2)^2): f^2 (1/f - 1/y) has spread s, dx = dy / y^2
      working.constant += 2.0 * (std::log(range) - std::log(f));
      range = 2.0 * f - f * f / range;
    }
    if (rows.reads_bearings())
      working.bearing[i] = wrap_angle(rows.bearing_rad[i] - changes.bearing[i] - geometry.bearing[cell]);
  }
  const bool tails_along = has_tails(model) && !rows.sequence.empty() && dependence.range_correlation > 0.0 &&
                           dependence.range_correlated_share > 0.0;
  if (tails_along)
    add_tails_along(rows, geometry, model, changes, dependence, range_m, working);
  else if (has_tails(model))
    add_tails(rows, geometry, model, changes, dependence.range_cell_sigma_m, range_m, working);
  if (rows.sequence.empty()) {
    working.range_whitening = whitening_of(range_m, dependence.range_correlation);
  } else {
    working.range_whitening = whitening_of(range_m, 0.0);
    if (!tails_along) working.serial = serial_errors_of(rows, model);
    working.constant += 0.5 * working.serial.log_determinant();
  }
  CellsAndRows range = split(rows, working.range, working.range_whitening);
  working.constant += working.range_whitening.log_jacobian(rows);
  for (int cell = 0; cell < rows.cell_count; ++cell) {
    const double ratio = shared_variance(dependence.range_cell_sigma_m, changes.rounding.range, cell) /
                         (geometry.spread[cell] * geometry.spread[cell]);
    const double s = geometry.spread[cell];
    const int begin = rows.cell_begin[cell], count = rows.cell_begin[cell + 1] - begin;
    const double extra =
        working.tail_square.size() > 0 ? s * s * working.tail_square.segment(begin, count).sum() : 0.0;
    c.range_mean[cell] = range.means[cell];
    set_weight(range, cell, ratio, extra, rows, c.range_weight[cell], c.range_mean_square[cell],
               working.constant);
  }
  working.range_deviation = std::move(range.deviations);
  if (!rows.reads_bearings()) {
    working.bearing_deviation.setZero(n);
    return working;
  }
  working.bearing_whitening = whitening_of(bearing_m, dependence.bearing_correlation);
  CellsAndRows bearing = split(rows, working.bearing, working.bearing_whitening);
  working.constant += working.bearing_whitening.log_jacobian(rows);
  for (int cell = 0; cell < rows.cell_count; ++cell) {
    const double ratio = shared_variance(dependence.bearing_cell_sigma_rad, changes.rounding.bearing, cell) /
                         (state.sigma_theta_rad * state.sigma_theta_rad);
    c.bearing_mean[cell] = wrap_angle(geometry.bearing[cell] + bearing.means[cell]);
    set_weight(bearing, cell, ratio, 0.0, rows, c.bearing_weight[cell], c.bearing_mean_square[cell],
               working.constant);
  }
  working.bearing_deviation = std::move(bearing.deviations);
  return working;
}

Eigen::VectorXd sequence_residuals(const WorkingProblem& working, const CellGeometry& geometry) {
  const Cells& c = working.problem.cells;
  Eigen::VectorXd e(static_cast<Eigen::Index>(c.size()));
  for (std::size_t i = 0; i < c.size(); ++i)
    e[static_cast<Eigen::Index>(i)] = std::sqrt(c.range_weight[i]) *
                                      (c.range_mean[i] - geometry.f[i] - c.effect_change(i, geometry.d[i])) /
                                      geometry.spread[i];
  return e;
}

double serial_nll(const Rows& rows, const WorkingProblem& working, const JointState& state) {
  if (working.serial.independent()) return 0.0;
  const Eigen::VectorXd e = sequence_residuals(working, cell_geometry(rows, state));
  return 0.5 * (working.serial.whitened(e).squaredNorm() - e.squaredNorm());
}

double nll_at(const Rows& rows, const WorkingProblem& working, const JointState& state) {
  return joint_nll(working.problem, state) + working.constant + serial_nll(rows, working, state);
}

double level_of_errors(const Rows& rows, const WorkingProblem& working, const JointState& state) {
  const CellGeometry geometry = cell_geometry(rows, state);
  std::vector<double> sizes(rows.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    const auto cell = static_cast<std::size_t>(rows.cell[i]);
    sizes[i] = std::abs(working.range_with_tail(static_cast<Eigen::Index>(i)) - geometry.f[cell]) /
               geometry.spread[cell];
  }
  return upper_median(std::move(sizes)) / median_of_normal_size;
}

JointState with_robust_noise(const Rows& rows, const Model& model, JointState state) {
  const double level = level_of_errors(rows, working_problem(rows, model, state), state);
  state.noise.parameters[0] *= std::clamp(level, 1e-3, 1.0);
  return state;
}

Signature effect_signature(const Rows& rows, const Projector& projector, const ActiveEffect& active,
                           int index) {
  const EffectParameter& info = active.effect->info().parameters[index];
  const double step = difference_step(info, active.parameters[index]);
  ActiveEffect up = active, down = active;
  up.parameters[index] += step;
  down.parameters[index] -= step;
  // About 0 a change that is linear in its amplitudes is odd in each: one side of the difference is enough. Effects with a part
  // that does not vanish with them state their slopes.
  bool odd = info.linear;
  for (Eigen::Index j = 0; j < active.parameters.size() && odd; ++j)
    odd =
        !active.effect->info().parameters[static_cast<std::size_t>(j)].linear || active.parameters[j] == 0.0;
  Signature x;
  const auto slope_at = [&](int i, double& range, double& bearing, const CellGeometry& geometry) {
    const ReadingView<double> view = view_of(rows, geometry, static_cast<std::size_t>(i));
    const double gain =
        geometry.stages.gain(active.effect->info().stage, rows.cell[static_cast<std::size_t>(i)]);
    if (const auto slope = active.effect->slope(view, active.parameters.data(), index)) {
      range = gain * slope->range;
      bearing = slope->bearing;
      return;
    }
    const auto high = active.effect->reading(view, up.parameters.data());
    if (odd) {
      range = gain * high.range / step;
      bearing = high.bearing / step;
      return;
    }
    const auto low = active.effect->reading(view, down.parameters.data());
    range = gain * (high.range - low.range) / (2.0 * step);
    bearing = (high.bearing - low.bearing) / (2.0 * step);
  };
  // Of an effect that may differ between the repeats of a cell its first, second and last row tell whether it does.
  x.range.resize(rows.cell_count);
  x.bearing.resize(rows.cell_count);
  bool varies = false;
  for (int c = 0; c < rows.cell_count && !varies; ++c) {
    const int first = rows.cell_begin[c], last = rows.cell_begin[c + 1] - 1;
    slope_at(first, x.range[c], x.bearing[c], projector.geometry());
    for (int i : {std::min(first + 1, last), last}) {
      double range = 0.0, bearing = 0.0;
      if (i == first || !active.effect->differs_between_repeats()) continue;
      slope_at(i, range, bearing, projector.geometry());
      varies = varies || std::abs(range - x.range[c]) > 1e-12 * (1.0 + std::abs(range)) ||
               std::abs(bearing - x.bearing[c]) > 1e-12 * (1.0 + std::abs(bearing));
    }
  }
  if (varies) {
    const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
    Eigen::VectorXd range(n), bearing(n);
    for (int i = 0; i < n; ++i) slope_at(i, range[i], bearing[i], projector.geometry());
    x = projector.of_rows(range, bearing);
  }
  if (projector.moved(false)) {  // of the first row, which stands for its cell
    Eigen::VectorXd range_changes = Eigen::VectorXd::Zero(rows.cell_count), bearing_changes = range_changes;
    const bool of_range = !x.range.isZero(0.0), of_bearing = !x.bearing.isZero(0.0);
    for (int c = 0; c < rows.cell_count; ++c) {
      double range = x.range[c], bearing = x.bearing[c], unused = 0.0;
      const int first = rows.cell_begin[c];
      if (varies) slope_at(first, range, bearing, projector.geometry());
      if (of_range) slope_at(first, range_changes[c], unused, *projector.moved(false));
      if (of_bearing) slope_at(first, unused, bearing_changes[c], *projector.moved(true));
      if (of_range) range_changes[c] -= range;
      if (of_bearing) bearing_changes[c] -= bearing;
    }
    projector.set_drift(range_changes, bearing_changes, x);
  }
  if (active.effect->acts_on_stops()) {
    // The path as it is estimated: what scales or turns the path and all landmarks with it is absorbed along
    // the estimated one. Along the commanded path the errors of the stops would be left over and judge
    // themselves.
    std::vector<StopPrior> high = rows.problem.stops;
    for (std::size_t k = 0; k < high.size(); ++k) {
      const Eigen::Vector3d& error = projector.stop_errors()[k];
      high[k].commanded.x_m += error.x();
      high[k].commanded.y_m += error.y();
      high[k].commanded.heading_rad += error.z();
    }
    std::vector<StopPrior> low = high;
    active.effect->stops(rows.context, up.parameters.data(), high);
    active.effect->stops(rows.context, down.parameters.data(), low);
    std::vector<Eigen::Vector3d> slopes = moves_between(low, high);
    for (Eigen::Vector3d& slope : slopes) slope /= 2.0 * step;
    add(projector.of_stops(slopes), x);
    x.moves_stops = true;
  }
  return x;
}

void add_stop_changes(const Rows& rows, const Projector& projector, const Model& model, Signature& x) {
  std::vector<StopPrior> after = rows.problem.stops;
  bool moves = false;
  for (const ActiveEffect& active : model)
    if (active.effect->acts_on_stops()) {
      active.effect->stops(rows.context, active.parameters.data(), after);
      moves = true;
    }
  if (moves) add(projector.of_stops(moves_between(rows.problem.stops, after)), x);
}

void variance_signature(const Rows& rows, const CellGeometry& geometry, const ActiveEffect& active, int index,
                        Eigen::VectorXd& range, Eigen::VectorXd& bearing) {
  const auto n = static_cast<Eigen::Index>(rows.size());
  const auto slope_at = [&](Eigen::Index i) {
    return active.effect->slope(view_of(rows, geometry, static_cast<std::size_t>(i)),
                                active.parameters.data(), index);
  };
  if (slope_at(0)) {
    range.resize(n);
    bearing.resize(n);
    for (Eigen::Index i = 0; i < n; ++i) {
      const auto slope = slope_at(i);
      range[i] = slope->range_log_variance;
      bearing[i] = slope->bearing_log_variance;
    }
    return;
  }
  const double step = difference_step(active.effect->info().parameters[static_cast<std::size_t>(index)],
                                      active.parameters[index]);
  Model up{active}, down{active};
  up[0].parameters[index] += step;
  down[0].parameters[index] -= step;
  const RowChanges high = row_changes(rows, geometry, up), low = row_changes(rows, geometry, down);
  range = (high.range_log_variance - low.range_log_variance) / (2.0 * step);
  bearing = (high.bearing_log_variance - low.bearing_log_variance) / (2.0 * step);
}

}  // namespace rangecal::diagnosis
