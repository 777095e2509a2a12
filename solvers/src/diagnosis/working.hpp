// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "diagnosis/projector.hpp"
#include "diagnosis/rounding.hpp"
#include "diagnosis/rows.hpp"
#include "diagnosis/working_problem.hpp"

namespace rangecal::diagnosis {

/// One effect of a model with its parameters.
struct ActiveEffect {
  const Effect* effect = nullptr;
  Eigen::VectorXd parameters;
};
using Model = std::vector<ActiveEffect>;

/// Slope in d of what an effect adds to the mean range of a reading; beside a jump on the reading's own side.
double effect_slope_of(const ActiveEffect& active, const ReadingView<double>& at);

/// True if an effect gives a share of the readings an extra error.
bool is_tail(const ActiveEffect& active);
bool has_tails(const Model& model);
/// True if some effect of the model is a grid that the values sit on.
bool has_grid(const Model& model);
/// True if some effect makes 1/y normal about 1/f.
bool has_reciprocal_noise(const Model& model);
/// The model less its grids.
Model without_grids(const Model& model);

/// How the readings of one cell hang together under all of the model's effects but its grids, which share by cell.
Dependence dependence_of(const Model& model);
/// How the errors of the model hang together along the sequence, its tails left out.
SerialErrors serial_errors_of(const Rows& rows, const Model& model);

class Sides;

/// The stops with what the model's effects do to them.
std::vector<StopPrior> commanded_under(const Rows& rows, const Model& model);

/// Effects are evaluated at `state`; their dependence on the geometry is carried by repeating this at the new
/// state. `sides`: those of switching distances on which readings are taken to lie; none: as the state has them.
WorkingProblem working_problem(const Rows& rows, const Model& model, const JointState& state,
                               const Sides* sides = nullptr);

/// Its cells alone, without a pass over the rows where the model's effects are the same for all repeats of a cell: what a solve needs.
WorkingCells working_cells(const Rows& rows, const Model& model, const JointState& state,
                           const Sides* sides = nullptr);

/// Lets the fit follow effects that change fast with distance, as it moves cells: their slope goes along.
/// Slow ones (below a fiftieth of a metre per metre) need none: evaluating them anew at the fit is enough.
void set_effect_slopes(const Rows& rows, const CellGeometry& geometry, const Model& model, const Sides* sides,
                       Cells& cells);

/// Residuals of the working problem's ranges in units of their standard deviations, sqrt(W) (y - f) / s, of the cells.
Eigen::VectorXd sequence_residuals(const WorkingProblem& working, const CellGeometry& geometry);

/// What errors that depend on one another along a sequence add to the NLL of the working problem [nats], whose cells take them
/// for independent; 0 where they are. Their determinant is in `constant`.
double serial_nll(const Rows& rows, const WorkingProblem& working, const JointState& state);

/// NLL of the readings themselves [nats] with the state's own stops, by the working problem at that state.
double nll_at(const Rows& rows, const WorkingProblem& working, const JointState& state);

/// Median size of the ranges' errors under the working problem, over that of a normal law: 1 where the spreads are right.
double level_of_errors(const Rows& rows, const WorkingProblem& working, const JointState& state);

/// The state with the level of the noise, where it is too high, at which half of the readings lie within 0.6745 spreads: that of
/// a fit that knew no outliers is theirs.
JointState with_robust_noise(const Rows& rows, const Model& model, JointState state);

/// Per-row change of all of the model's effects, and what its grids add to the cells, their repeats' own part
/// in the rows' variance already.
struct RowChanges {
  Eigen::VectorXd range, bearing, range_log_variance, bearing_log_variance;
  CellRounding rounding;
};
RowChanges row_changes(const Rows& rows, const CellGeometry& geometry, const Model& model,
                       const Sides* sides = nullptr);

/// The effects of a model that change the mean or the variance of readings one by one, by index.
struct ReadingEffects {
  std::vector<std::size_t> of_cells;  ///< the same for all repeats of a cell, in the order of their stages
  std::vector<std::size_t> of_rows;   ///< the others
  explicit ReadingEffects(const Model& model);
};
/// The change of a reading of a cell by some of them together.
ReadingChange<double> change_at(const Model& model, const std::vector<std::size_t>& effects,
                                const Sides* sides, int cell, const ReadingView<double>& view);

/// The effects of the path first.
Model in_order_of_stages(Model model);
/// The stages of a model's effects: those on the path and the light, evaluated at the first row of each cell. Empty where no effect is
/// of an earlier stage than the readings' own.
Stages stages_of(const Rows& rows, const CellGeometry& geometry, const Model& model);

/// The laws of rows' errors under the model's tail effects, empty without one. Of a row with the shares of the row before, the
/// sizes alone are set anew.
class TailLaws {
 public:
  TailLaws(const Rows& rows, const CellGeometry& geometry, const Model& model);
  const TailLaw& of(std::size_t row);
  /// Effect of the model that gives each share of the last law.
  const std::vector<int>& effects() const { return effect_of_share_; }

 private:
  const Rows& rows_;
  const CellGeometry& geometry_;
  const Model& model_;
  std::vector<int> tails_, effect_of_share_;  ///< by index in the model
  std::vector<Contamination> parts_;          ///< of `law_`, by tail
  TailLaw law_;
};
/// That of one row.
TailLaw tail_law_of(const Rows& rows, const CellGeometry& geometry, const Model& model, std::size_t row);

/// Derivative of the readings with respect to parameter `index` of `active`, stops included, by central
/// differences.
Signature effect_signature(const Rows& rows, const Projector& projector, const ActiveEffect& active,
                           int index);

/// Adds to `x` how the model moves the commanded stops.
void add_stop_changes(const Rows& rows, const Projector& projector, const Model& model, Signature& x);

/// Derivative of the log variances of the rows (range, bearing) with respect to it; zero if it has none.
void variance_signature(const Rows& rows, const CellGeometry& geometry, const ActiveEffect& active, int index,
                        Eigen::VectorXd& range, Eigen::VectorXd& bearing);

}  // namespace rangecal::diagnosis
