// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/projector.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal::diagnosis {

namespace {

/// The problem with its spreads held: the information of the means alone, and none of what spreads say of
/// distances.
JointProblem with_held_spreads(JointProblem problem, const CellGeometry& geometry) {
  for (std::size_t i = 0; i < problem.cells.size(); ++i)
    problem.cells.range_weight[i] /= geometry.spread[i] * geometry.spread[i];
  return problem;
}

bool knows_its_stops(const JointLayout& layout) {
  return std::none_of(layout.nodes.begin(), layout.nodes.end(),
                      [](const JointLayout::Node& node) { return node.free_position; });
}

JointState with_unit_noise(JointState state) {
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Ones(1);
  return state;
}

}  // namespace

void Signature::scale(double factor) {
  range *= factor;
  bearing *= factor;
  range_rows *= factor;
  bearing_rows *= factor;
  drift *= factor;
  follows *= factor;
}

void Signature::take_out(double share, const Signature& other) {
  range -= share * other.range;
  bearing -= share * other.bearing;
  drift -= share * other.drift;
  turns = turns || other.turns;
  if (follows.size() == 0)
    follows = -share * other.follows;
  else if (other.follows.size() > 0)
    follows -= share * other.follows;
  if (!within() || !other.within()) return;
  range_rows -= share * other.range_rows;
  bearing_rows -= share * other.bearing_rows;
}

void Signature::see_whether_it_turns(double information) {
  constexpr double most = 0.2;  // standard deviations of the score
  turns = turns || (follows.size() > 0 && follows.cwiseAbs2().maxCoeff() > most * most * information);
}

Projector::Projector(const Rows& rows, const WorkingProblem& working, const JointState& state)
    : row_range_residual(working.range_deviation),
      row_bearing_residual(working.bearing_deviation),
      rows_(rows),
      geometry_(cell_geometry(rows, state)),
      range_whitening_(working.range_whitening),
      bearing_whitening_(working.bearing_whitening),
      serial_(working.serial),
      problem_(with_held_spreads(working.problem, geometry_)),
      system_(problem_, static_cast<int>(state.alpha.size()), 1),
      only_alpha_(rows.pairs && knows_its_stops(system_.layout())) {
  geometry_.stages = working.stages;
  const JointProblem& problem = working.problem;
  const Cells& c = problem.cells;
  const int cells = static_cast<int>(c.size());
  for (auto* column : {&range_residual, &bearing_residual, &range_information, &bearing_information})
    column->resize(cells);
  slope_.resize(cells);
  const double bearing_weight =
      rows.reads_bearings() ? 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad) : 0.0;
  for (int i = 0; i < cells; ++i) {
    // Stops of pairs move on the curve's scale.
    slope_[i] = geometry_.slope[i] / rows.curve.scale.slope(geometry_.d[i]) +
                (c.effect_slope.empty() ? 0.0 : c.effect_slope[i]);
    range_residual[i] =
        c.range_mean[i] - geometry_.f[i] - c.effect_change(static_cast<std::size_t>(i), geometry_.d[i]);
    bearing_residual[i] = rows.reads_bearings() ? wrap_angle(c.bearing_mean[i] - geometry_.bearing[i]) : 0.0;
    range_information[i] = c.range_weight[i] / (geometry_.spread[i] * geometry_.spread[i]);
    bearing_information[i] = c.bearing_weight[i] * bearing_weight;
  }
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  row_range_information.resize(n);
  row_bearing_information.setConstant(n, bearing_weight);
  for (Eigen::Index i = 0; i < n; ++i)
    row_range_information[i] = 1.0 / std::pow(geometry_.spread[rows.cell[i]], 2);
  for (std::size_t k = 0; k < problem.stops.size(); ++k) {
    const Pose2 &is = state.stops[k], &meant = problem.stops[k].commanded;
    stop_errors_.emplace_back(is.x_m - meant.x_m, is.y_m - meant.y_m,
                              wrap_angle(is.heading_rad - meant.heading_rad));
  }
  if (rows.pairs) {
    const Eigen::Map<const Eigen::VectorXd> u(geometry_.u.data(), cells);
    powers_.setOnes(cells, system_.layout().alpha_count);
    for (Eigen::Index a = 1; a < powers_.cols(); ++a) powers_.col(a) = powers_.col(a - 1).cwiseProduct(u);
  }
  system_.assemble(with_unit_noise(state), HessianKind::fisher);
  system_.eliminate();
  if (!rows.pairs) beside_known_stops_.compute(information_beside_known_stops());  // of its lower half
  // Pseudo-inverse on phi: a direction the recording does not determine is left alone, not divided by zero.
  const int phi = rows.pairs ? system_.layout().alpha_count : system_.layout().phi_count;
  phi_factor_ = Eigen::MatrixXd::Zero(system_.layout().global_count, system_.layout().global_count);
  Eigen::MatrixXd information = system_.schur().topLeftCorner(phi, phi);
  const int alphas = system_.layout().alpha_count;
  if (!serial_.independent()) information = serial_information();
  if (rows.alpha_prior && rows.alpha_prior->exact()) {
    information.leftCols(alphas).setZero();
    information.topRows(alphas).setZero();
  } else if (rows.alpha_prior) {
    information.topLeftCorner(alphas, alphas) += rows.alpha_prior->precision;
  }
  Eigen::VectorXd scale = information.diagonal();
  for (double& s : scale) s = s > 0.0 ? 1.0 / std::sqrt(s) : 0.0;
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * information * scale.asDiagonal());
  Eigen::VectorXd inverse = eigen.values;
  for (double& value : inverse) value = value > 1e-11 ? 1.0 / value : 0.0;
  for (const double value : inverse)
    if (value > 0.0) log_phi_volume_ += 0.5 * std::log(value);
  for (const double s : scale)
    if (s > 0.0) log_phi_volume_ += std::log(s);
  phi_factor_.topLeftCorner(phi, phi) = scale.asDiagonal() * eigen.vectors * inverse.asDiagonal() *
                                        eigen.vectors.transpose() * scale.asDiagonal();
  // Effects that change fast with distance leave the calibration a little off its optimum when the readings
  // are corrected anew. Scores speak of residuals at the optimum: its last step is taken to first order.
  Eigen::VectorXd pull = -system_.global_gradient();
  if (!serial_.independent()) {
    Signature residuals;
    residuals.range = range_residual;
    residuals.bearing = bearing_residual;
    pull = pulls(residuals).globals;
  }
  alpha_gradient_ =
      serial_.independent() ? system_.reduced_gradient().head(alphas).eval() : -pull.head(alphas);
  const auto settle = [&](Eigen::VectorXd& range, Eigen::VectorXd& bearing) {
    pull.tail(pull.size() - phi).setZero();
    const Eigen::VectorXd settled = system_.solve_stops(-system_.stop_gradient());
    const Eigen::VectorXd step = phi_factor_ * (pull - system_.couple(settled));
    const Signature moved = of_calibration(step, settled + system_.back_substitute(step, false));
    range -= moved.range;
    if (!rows.pairs) bearing -= moved.bearing;
  };
  plain_range_ = range_residual;
  plain_bearing_ = bearing_residual;
  settle(plain_range_, plain_bearing_);
  if (!rows.pairs && c.effect_slope.empty())
    pull -= expect_scores();  // a fast bend has no second derivative to go by
  settle(range_residual, bearing_residual);
  if (!serial_.independent()) weighted_residual_ = weighted(range_residual);
}

Eigen::VectorXd Projector::whitened(const Eigen::VectorXd& range) const {
  return serial_.whitened(range.cwiseProduct(range_information.cwiseSqrt()));
}

Eigen::VectorXd Projector::coloured(const Eigen::VectorXd& white) const {
  return serial_.coloured(white).cwiseQuotient(range_information.cwiseMax(1e-300).cwiseSqrt());
}

Eigen::VectorXd Projector::weighted(const Eigen::VectorXd& range) const {
  if (serial_.independent()) return range_information.cwiseProduct(range);
  return serial_.transposed(whitened(range)).cwiseProduct(range_information.cwiseSqrt());
}

Eigen::VectorXd Projector::unweighted(const Eigen::VectorXd& range) const {
  if (serial_.independent()) return range.cwiseQuotient(range_information.cwiseMax(1e-300));
  const Eigen::VectorXd scaled = range.cwiseQuotient(range_information.cwiseMax(1e-300).cwiseSqrt());
  return coloured(serial_.transpose_coloured(scaled));
}

/// J^T W J of (alpha, landmarks).
Eigen::MatrixXd Projector::information_beside_known_stops() const {
  const JointLayout& layout = system_.layout();
  const int alphas = layout.alpha_count;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(layout.phi_count, layout.phi_count);
  Eigen::VectorXd curve(alphas);
  for (int i = 0; i < cells(); ++i) {
    double power = 1.0;
    for (double& slope : curve) slope = std::exchange(power, power * geometry_.u[i]);
    const int at = layout.landmark_begin + 2 * problem_.cells.landmark[i];
    const Eigen::Vector2d along = slope_[i] * geometry_.n[i],
                          across = geometry_.t[i] / geometry_.axis_distance[i];
    information.topLeftCorner(alphas, alphas) += range_information[i] * curve * curve.transpose();
    information.block(at, 0, 2, alphas) += range_information[i] * along * curve.transpose();
    information.block<2, 2>(at, at) += range_information[i] * along * along.transpose() +
                                       bearing_information[i] * across * across.transpose();
  }
  information.diagonal() *= 1.0 + 1e-12;
  return information;
}

/// J^T W J of alpha.
Eigen::MatrixXd Projector::serial_information() const {
  const SerialErrors::Columns columns =
      serial_.whitened_columns(range_information.cwiseSqrt().asDiagonal() * powers_);
  return columns.transpose() * columns;
}

Projector::Pulls Projector::pulls(const Signature& x) const {
  const JointLayout& layout = system_.layout();
  const Cells& c = problem_.cells;
  Pulls sum{Eigen::VectorXd::Zero(layout.global_count), Eigen::VectorXd::Zero(layout.coordinates)};
  const Eigen::VectorXd ranges = weighted(x.range);
  if (only_alpha_) {
    sum.globals.head(layout.alpha_count) = powers_.transpose() * ranges;
    return sum;
  }
  for (int i = 0; i < cells(); ++i) {
    const double range = ranges[i], bearing = bearing_information[i] * x.bearing[i];
    double power = range;
    for (int a = 0; a < layout.alpha_count; ++a, power *= geometry_.u[i]) sum.globals[a] += power;
    const Eigen::Vector2d pull =
        range * slope_[i] * geometry_.n[i] + bearing / geometry_.axis_distance[i] * geometry_.t[i];
    sum.globals.segment<2>(layout.landmark_begin + 2 * c.landmark[i]) += pull;
    const int k = c.stop[i];
    const JointLayout::Node& node = layout.nodes[layout.node_of_stop[k]];
    if (node.free_position) sum.stops.segment<2>(node.coordinate) -= pull;
    const int heading = node.heading[layout.slot_of_stop[k]];
    if (heading >= 0) sum.stops[node.coordinate + heading] -= bearing;
  }
  return sum;
}

void Projector::absorbed(const Signature& x, Eigen::VectorXd& phi, Eigen::VectorXd& stops) const {
  const Pulls pull = pulls(x);
  if (only_alpha_) {
    phi = phi_factor_ * pull.globals;
    stops = pull.stops;
    return;
  }
  const Eigen::VectorXd settled = system_.solve_stops(pull.stops);
  phi = phi_factor_ * (pull.globals - system_.couple(settled));
  stops = settled + system_.back_substitute(phi, false);
}

Signature Projector::of_calibration(const Eigen::VectorXd& phi, const Eigen::VectorXd& stops) const {
  const JointLayout& layout = system_.layout();
  const Cells& c = problem_.cells;
  Signature x;
  if (only_alpha_) {
    x.range = powers_ * phi.head(layout.alpha_count);
    x.bearing = Eigen::VectorXd::Zero(cells());
    return x;
  }
  x.range.resize(cells());
  x.bearing.resize(cells());
  for (int i = 0; i < cells(); ++i) {
    const int k = c.stop[i];
    const JointLayout::Node& node = layout.nodes[layout.node_of_stop[k]];
    Eigen::Vector2d moved = phi.segment<2>(layout.landmark_begin + 2 * c.landmark[i]);
    if (node.free_position) moved -= stops.segment<2>(node.coordinate);
    const int heading = node.heading[layout.slot_of_stop[k]];
    const double turn = heading >= 0 ? stops[node.coordinate + heading] : 0.0;
    double curve = 0.0;
    for (int a = layout.alpha_count; a-- > 0;) curve = curve * geometry_.u[i] + phi[a];
    x.range[i] = curve + slope_[i] * geometry_.n[i].dot(moved);
    x.bearing[i] = geometry_.t[i].dot(moved) / geometry_.axis_distance[i] - turn;
  }
  return x;
}

Eigen::VectorXd Projector::project(const Signature& x) const {
  Eigen::VectorXd phi, stops;
  absorbed(x, phi, stops);
  const Signature taken = of_calibration(phi, stops);
  Eigen::VectorXd result(2 * cells());
  result.head(cells()) = weighted(x.range - taken.range);
  result.tail(cells()) = bearing_information.cwiseProduct(x.bearing - taken.bearing);
  return result;
}

double Projector::inner(const Signature& x, const Eigen::VectorXd& projected_y, const Signature& y) const {
  double sum = x.range.dot(projected_y.head(cells())) + x.bearing.dot(projected_y.tail(cells()));
  if (x.within() && y.within())
    sum += x.range_rows.cwiseProduct(row_range_information).dot(y.range_rows) +
           x.bearing_rows.cwiseProduct(row_bearing_information).dot(y.bearing_rows);
  return sum;
}

double Projector::score(const Signature& x) const {
  const bool plain = x.turns || moved_.empty();
  double sum = (serial_.independent()
                    ? x.range.cwiseProduct(range_information).dot(plain ? plain_range_ : range_residual)
                    : x.range.dot(weighted_residual_)) +
               x.bearing.cwiseProduct(bearing_information).dot(plain ? plain_bearing_ : bearing_residual);
  if (!plain)
    sum -= x.range.cwiseProduct(range_information).dot(expected_.range) +
           x.bearing.cwiseProduct(bearing_information).dot(expected_.bearing) + x.drift;
  if (x.within())
    sum += x.range_rows.cwiseProduct(row_range_information).dot(row_range_residual) +
           x.bearing_rows.cwiseProduct(row_bearing_information).dot(row_bearing_residual);
  return sum;
}

double Projector::raw_information(const Signature& x) const { return raw_inner(x, x); }

double Projector::beside_stops(const Signature& x) const {
  const Eigen::VectorXd pull = pulls(x).stops;
  return raw_information(x) - pull.dot(system_.solve_stops(pull));
}

double Projector::beside_known_stops(const Signature& x) const {
  const Eigen::VectorXd pull = pulls(x).globals.head(beside_known_stops_.rows());
  return raw_information(x) - pull.dot(beside_known_stops_.solve(pull));
}

double Projector::least_information(const Signature& x) const {
  constexpr double rounding = 1e-9, absorbed = 1e-4;
  const double raw = raw_information(x);
  if (!x.moves_stops) return 1e-5 * raw;
  if (beside_known_stops(x) < absorbed * raw) return std::numeric_limits<double>::infinity();
  return std::max(rounding * raw, absorbed * beside_stops(x));
}

double Projector::raw_inner(const Signature& x, const Signature& y) const {
  double sum = (serial_.independent() ? x.range.cwiseProduct(range_information).dot(y.range)
                                      : whitened(x.range).dot(whitened(y.range))) +
               x.bearing.cwiseProduct(bearing_information).dot(y.bearing);
  if (x.within() && y.within())
    sum += x.range_rows.cwiseProduct(row_range_information).dot(y.range_rows) +
           x.bearing_rows.cwiseProduct(row_bearing_information).dot(y.bearing_rows);
  return sum;
}

Signature Projector::of_rows(const Eigen::VectorXd& range, const Eigen::VectorXd& bearing) const {
  Signature x;
  CellsAndRows ranges = split(rows_, range, range_whitening_),
               bearings = split(rows_, bearing, bearing_whitening_);
  x.range = std::move(ranges.means);
  x.bearing = std::move(bearings.means);
  const auto varies = [&](const Eigen::VectorXd& rows) {
    for (int c = 0; c < rows_.cell_count; ++c) {
      const auto of_cell = rows.segment(rows_.cell_begin[c], rows_.cell_begin[c + 1] - rows_.cell_begin[c]);
      if (of_cell.maxCoeff() - of_cell.minCoeff() > 1e-9 * (1e-6 + of_cell.cwiseAbs().maxCoeff()))
        return true;
    }
    return false;
  };
  if (!varies(range) && !varies(bearing)) return x;
  x.range_rows = std::move(ranges.deviations);
  x.bearing_rows = std::move(bearings.deviations);
  return x;
}

Signature Projector::of_stops(const std::vector<Eigen::Vector3d>& moved) const {
  Signature x;
  x.range.resize(cells());
  x.bearing.resize(cells());
  for (int i = 0; i < cells(); ++i) {
    const Eigen::Vector3d& step = moved[problem_.cells.stop[i]];
    x.range[i] = -slope_[i] * geometry_.n[i].dot(step.head<2>());
    x.bearing[i] = -geometry_.t[i].dot(step.head<2>()) / geometry_.axis_distance[i] - step[2];
  }
  for (std::size_t k = 0; k < curving_.size(); ++k)  // dx/dp = H moved
    x.drift += moved[k].head<2>().dot(curving_[k]);
  return x;
}

}  // namespace rangecal::diagnosis
