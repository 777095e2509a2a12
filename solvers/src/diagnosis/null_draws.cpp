// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/null_draws.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>

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
    if (prior.chained && prior.shape && prior.turns_add_up)  // a step's own covariance is in the frame of the stop before
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
      range_(range),
      bearing_(bearing),
      has_rows_(wants_rows || rows.size() <= most_rows) {}

Eigen::VectorXd NullDraws::draw_cells(Random& random) const {
  const int cells = projector_.cells();
  const Eigen::VectorXd range_sd = spread_of(projector_.range_information);
  Eigen::VectorXd errors = Eigen::VectorXd::Zero(2 * cells);
  for (int c = 0; c < cells; ++c) errors[c] = random.normal() * range_sd[c];
  if (!rows_.pairs) {
    const Eigen::VectorXd bearing_sd = spread_of(projector_.bearing_information);
    for (int c = 0; c < cells; ++c) errors[cells + c] = random.normal() * bearing_sd[c];
    const Signature stops = projector_.of_stops(stop_errors(problem_.stops, random));
    errors.head(cells) += stops.range;
    errors.tail(cells) += stops.bearing;
  }
  if (rows_.alpha_prior && !rows_.alpha_prior->exact()) {  // the simulation's own sampling error
    Eigen::VectorXd z(rows_.alpha_prior->mean.size());
    for (double& value : z) value = random.normal();
    const Eigen::VectorXd alpha = rows_.alpha_prior->precision.llt().matrixU().solve(z);
    for (int c = 0; c < cells; ++c) errors[c] += evaluate_polynomial(alpha, projector_.geometry().d[c]);
  }
  return errors;
}

Eigen::VectorXd NullDraws::draw_rows(const Eigen::VectorXd& information, Random& random) const {
  Eigen::VectorXd rows(information.size());
  for (int c = 0; c < rows_.cell_count; ++c) {
    const int begin = rows_.cell_begin[c], count = rows_.cell_begin[c + 1] - begin;
    auto of_cell = rows.segment(begin, count);
    for (int i = 0; i < count; ++i) of_cell[i] = random.normal() / std::sqrt(information[begin + i]);
    of_cell.array() -= of_cell.mean();
  }
  return rows;
}

NullDraw NullDraws::draw(Random& random) const {
  const int cells = projector_.cells();
  NullDraw draw;
  draw.cells = draw_cells(random);
  Signature errors;
  errors.range = draw.cells.head(cells);
  errors.bearing = draw.cells.tail(cells);
  Eigen::VectorXd phi, stops;
  projector_.absorbed(errors, phi, stops);
  const Signature taken = projector_.of_calibration(phi, stops);

  UnitResiduals left;
  left.stops = stops;
  const auto settle = [&](const VarianceUnits& units, const Eigen::VectorXd& information,
                          const Eigen::VectorXd& row_information, const Eigen::VectorXd& cell_errors,
                          Eigen::VectorXd& unit_cells, Eigen::VectorXd& unit_rows, Eigen::VectorXd& rows,
                          Eigen::VectorXd& excess) {
    unit_cells = cell_errors.cwiseProduct(information.cwiseSqrt());
    Eigen::VectorXd square(2 * cells);
    square.tail(cells) = unit_cells.cwiseAbs2();
    if (has_rows_) {
      rows = draw_rows(row_information, random);
      unit_rows = rows.cwiseProduct(row_information.cwiseSqrt());
      for (int c = 0; c < cells; ++c)
        square[c] = unit_rows.segment(rows_.cell_begin[c], rows_.cell_begin[c + 1] - rows_.cell_begin[c])
                        .squaredNorm();
    } else {
      square.head(cells) = drawn_units(units.dof.head(cells), random);
    }
    const double scale = std::sqrt(std::max(square.sum(), 1e-300) / std::max(units.dof.sum(), 1e-300));
    excess = square / (scale * scale) - units.dof;
    unit_cells /= scale;
    unit_rows /= scale;
    rows /= scale;
    return scale;
  };
  draw.cells.head(cells) /= settle(range_, projector_.range_information, projector_.row_range_information,
                                   errors.range - taken.range, left.range_cells, left.range_rows,
                                   draw.range_rows, draw.range_excess);
  if (!rows_.pairs)
    draw.cells.tail(cells) /=
        settle(bearing_, projector_.bearing_information, projector_.row_bearing_information,
               errors.bearing - taken.bearing, left.bearing_cells, left.bearing_rows, draw.bearing_rows,
               draw.bearing_excess);
  if (has_rows_) draw.scalars = scalars_.of(left);
  return draw;
}

}  // namespace rangecal::diagnosis
