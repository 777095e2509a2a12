// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/null_draws.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <utility>

#include "rangecal/core/polynomial.hpp"

namespace rangecal::diagnosis {
namespace {

constexpr std::size_t most_rows = 5000;  ///< beyond, the laws of sums over rows are what they tend to

/// Errors of the stops (dx, dy, dh) drawn from their prior, to first order: a heading error of the stop
/// before turns the commanded step of a random walk.
std::vector<Eigen::Vector3d> stop_errors(const std::vector<StopPrior>& stops, Random& random) {
  std::vector<Eigen::Vector3d> errors(stops.size());
  std::vector<Eigen::Vector2d> of_place;
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const StopPrior& prior = stops[k];
    const double unit_y = random.normal(), unit_x = random.normal(), unit_heading = random.normal();
    const Eigen::Vector3d drawn = stop_error(prior, prior.sigma_xy_m, {unit_x, unit_y, unit_heading});
    Eigen::Vector2d slip = drawn.head<2>();
    double turn = drawn.z();
    if (prior.chained && prior.shape &&
        prior.turns_add_up)  // a step's own covariance is in the frame of the stop before
      slip = Eigen::Rotation2Dd(stops[k - 1].commanded.heading_rad) * slip;
    Eigen::Vector2d error = slip;
    if (of_place.size() <= static_cast<std::size_t>(prior.place)) of_place.resize(prior.place + 1);
    if (prior.chained) {
      const Pose2 &from = stops[k - 1].commanded, &to = prior.commanded;
      const double turned = prior.turns_add_up ? errors[k - 1][2] : 0.0;
      error = errors[k - 1].head<2>() + turned * Eigen::Vector2d(from.y_m - to.y_m, to.x_m - from.x_m);
      if (prior.opens_place) error += slip;
      turn += turned;
    } else if (!prior.opens_place) {
      error = of_place[prior.place];
    }
    of_place[prior.place] = error;
    errors[k] << error, turn;
  }
  return errors;
}

Eigen::VectorXd spread_of(const Eigen::VectorXd& information) {
  return information.cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
}

/// chi-square units by Wilson and Hilferty's cube, good to a few per mille from two degrees of freedom on.
Eigen::VectorXd drawn_units(const Eigen::VectorXd& dof, Random& random) {
  Eigen::VectorXd square(dof.size());
  for (Eigen::Index u = 0; u < square.size(); ++u) {
    const double z = random.normal(), k = 2.0 / (9.0 * std::max(dof[u], 1e-3));
    square[u] = dof[u] < 1.5 ? dof[u] * z * z : dof[u] * std::pow(1.0 - k + z * std::sqrt(k), 3);
  }
  return square;
}

}  // namespace

NullDraws::NullDraws(const Rows& rows, const Projector& projector, const JointProblem& problem,
                     const ScalarTests& scalars, const VarianceUnits& range, const VarianceUnits& bearing,
                     bool wants_rows)
    : rows_(rows),
      projector_(projector),
      problem_(problem),
      scalars_(scalars),
      range_{range, projector.row_range_information.cwiseSqrt()},
      bearing_{bearing, projector.row_bearing_information.cwiseSqrt()},
      has_rows_(wants_rows || rows.size() <= most_rows) {}

Eigen::VectorXd NullDraws::draw_cells(Random& random) const {
  const int cells = projector_.cells();
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(2 * cells);
  for (int c = 0; c < cells; ++c) errors[c] = random.normal();
  errors.head(cells) = projector_.coloured(errors.head(cells));
  if (!rows_.pairs) {
    if (rows_.reads_bearings()) {
      const Eigen::VectorXd bearing_sd = spread_of(projector_.bearing_information);
      for (int c = 0; c < cells; ++c) errors[cells + c] = random.normal() * bearing_sd[c];
    }
    const Signature stops = projector_.of_stops(stop_errors(problem_.stops, random));
    errors.head(cells) += stops.range;
    errors.tail(cells) += stops.bearing;
  }
  if (rows_.alpha_prior && !rows_.alpha_prior->exact()) {  // the simulation's own sampling error
    Eigen::VectorXd z(rows_.alpha_prior->mean.size());
    for (double& value : z) value = random.normal();
    const Eigen::VectorXd alpha = rows_.alpha_prior->precision.llt().matrixU().solve(z);
    for (int c = 0; c < cells; ++c) errors[c] += evaluate_polynomial(alpha, projector_.geometry().u[c]);
  }
  return errors;
}

NullDraws::Settled NullDraws::settle(const Channel& channel, Eigen::VectorXd white, Random& random) const {
  const int cells = projector_.cells();
  const Eigen::VectorXd& dof = channel.units.dof;
  Settled settled;
  settled.cells = std::move(white);
  Eigen::VectorXd square(2 * cells);
  square.tail(cells) = settled.cells.cwiseAbs2();
  if (has_rows_) {
    settled.rows.resize(channel.row_scale.size());
    for (int c = 0; c < cells; ++c) {
      const int begin = rows_.cell_begin[c], count = rows_.cell_begin[c + 1] - begin;
      auto of_cell = settled.rows.segment(begin, count);
      for (double& row : of_cell) row = random.normal();
      of_cell.array() -= of_cell.mean();
      square[c] = of_cell.squaredNorm();
    }
  } else {
    square.head(cells) = drawn_units(dof.head(cells), random);
  }
  settled.scale = std::sqrt(std::max(square.sum(), 1e-300) / std::max(dof.sum(), 1e-300));
  settled.excess = square / (settled.scale * settled.scale) - dof;
  settled.cells /= settled.scale;
  settled.rows /= settled.scale;
  return settled;
}

NullDraw NullDraws::draw(Random& random) const {
  const int cells = projector_.cells();
  NullDraw draw;
  draw.cells = draw_cells(random);
  Signature errors;
  errors.range = draw.cells.head(cells);
  errors.bearing = draw.cells.tail(cells);
  UnitResiduals left;
  Eigen::VectorXd phi;
  projector_.absorbed(errors, phi, left.stops);
  const Signature taken = projector_.of_calibration(phi, left.stops);

  Settled range = settle(range_, projector_.whitened(errors.range - taken.range), random);
  draw.cells.head(cells) /= range.scale;
  draw.range_excess = std::move(range.excess);
  if (has_rows_) draw.range_rows = range.rows.cwiseQuotient(range_.row_scale);
  left.range_cells = std::move(range.cells);
  left.range_rows = std::move(range.rows);
  if (rows_.reads_bearings()) {
    Settled bearing = settle(
        bearing_, (errors.bearing - taken.bearing).cwiseProduct(projector_.bearing_information.cwiseSqrt()),
        random);
    draw.cells.tail(cells) /= bearing.scale;
    draw.bearing_excess = std::move(bearing.excess);
    if (has_rows_) draw.bearing_rows = bearing.rows.cwiseQuotient(bearing_.row_scale);
    left.bearing_cells = std::move(bearing.cells);
    left.bearing_rows = std::move(bearing.rows);
  }
  if (has_rows_) draw.scalars = scalars_.of(left);
  return draw;
}

}  // namespace rangecal::diagnosis
