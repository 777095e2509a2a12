// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/projector.hpp"

#include <cmath>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal::diagnosis {

Signature signature_of_rows(const Rows& rows, const Eigen::VectorXd& range, const Eigen::VectorXd& bearing) {
  Signature x;
  x.range = x.bearing = Eigen::VectorXd::Zero(rows.cell_count);
  bool varies = false;
  for (int c = 0; c < rows.cell_count; ++c) {
    const int begin = rows.cell_begin[c], count = rows.cell_begin[c + 1] - begin;
    const auto r = range.segment(begin, count);
    const auto b = bearing.segment(begin, count);
    x.range[c] = r.mean();
    x.bearing[c] = b.mean();
    if (count > 1 && (r.maxCoeff() - r.minCoeff() > 1e-9 * (1e-6 + r.cwiseAbs().maxCoeff()) ||
                      b.maxCoeff() - b.minCoeff() > 1e-9 * (1e-6 + b.cwiseAbs().maxCoeff())))
      varies = true;
  }
  if (!varies) return x;
  x.range_rows.resize(range.size());
  x.bearing_rows.resize(range.size());
  for (std::size_t i = 0; i < rows.size(); ++i) {
    x.range_rows[i] = range[i] - x.range[rows.cell[i]];
    x.bearing_rows[i] = bearing[i] - x.bearing[rows.cell[i]];
  }
  return x;
}

namespace {

/// The problem with its spreads held: the information of the means alone, and none of what spreads say of
/// distances.
JointProblem with_held_spreads(JointProblem problem, const CellGeometry& geometry) {
  for (std::size_t i = 0; i < problem.cells.size(); ++i)
    problem.cells.range_weight[i] /= geometry.spread[i] * geometry.spread[i];
  return problem;
}

JointState with_unit_noise(JointState state) {
  state.noise.law = NoiseLaw::constant;
  state.noise.parameters = Eigen::VectorXd::Ones(1);
  return state;
}

}  // namespace

Projector::Projector(const Rows& rows, const JointProblem& problem, const JointState& state)
    : rows_(rows),
      geometry_(cell_geometry(rows, state)),
      problem_(with_held_spreads(problem, geometry_)),
      system_(problem_, static_cast<int>(state.alpha.size()), 1) {
  const Cells& c = problem.cells;
  const int cells = static_cast<int>(c.size());
  for (auto* column : {&range_residual, &bearing_residual, &range_information, &bearing_information})
    column->resize(cells);
  slope_.resize(cells);
  const double bearing_weight = rows.pairs ? 0.0 : 1.0 / (state.sigma_theta_rad * state.sigma_theta_rad);
  for (int i = 0; i < cells; ++i) {
    slope_[i] = geometry_.slope[i] + (c.bend.empty() ? 0.0 : c.bend[i]);
    range_residual[i] =
        c.range_mean[i] - geometry_.f[i] - c.bent(static_cast<std::size_t>(i), geometry_.d[i]);
    bearing_residual[i] = rows.pairs ? 0.0 : wrap_angle(c.bearing_mean[i] - geometry_.bearing[i]);
    range_information[i] = c.range_weight[i] / (geometry_.spread[i] * geometry_.spread[i]);
    bearing_information[i] = c.bearing_weight[i] * bearing_weight;
  }
  const Eigen::Index n = static_cast<Eigen::Index>(rows.size());
  for (auto* column :
       {&row_range_information, &row_bearing_information, &row_range_residual, &row_bearing_residual})
    column->resize(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const int cell = rows.cell[i];
    const double count = rows.cell_begin[cell + 1] - rows.cell_begin[cell];
    row_range_information[i] = 1.0 / (geometry_.spread[cell] * geometry_.spread[cell]);
    row_bearing_information[i] = bearing_weight;
    row_range_residual[i] = count > 1 ? rows.range_m[i] - rows.problem.cells.range_mean[cell] : 0.0;
    row_bearing_residual[i] =
        count > 1 ? wrap_angle(rows.bearing_rad[i] - rows.problem.cells.bearing_mean[cell]) : 0.0;
  }
  for (std::size_t k = 0; k < problem.stops.size(); ++k) {
    const Pose2 &is = state.stops[k], &meant = problem.stops[k].commanded;
    stop_errors_.emplace_back(is.x_m - meant.x_m, is.y_m - meant.y_m,
                              wrap_angle(is.heading_rad - meant.heading_rad));
  }
  system_.assemble(with_unit_noise(state), HessianKind::fisher);
  system_.eliminate();
  // Pseudo-inverse on phi: a direction the recording does not determine is left alone, not divided by zero.
  const int phi = rows.pairs ? system_.layout().alpha_count : system_.layout().phi_count;
  phi_factor_ = Eigen::MatrixXd::Zero(system_.layout().global_count, system_.layout().global_count);
  Eigen::MatrixXd information = system_.schur().topLeftCorner(phi, phi);
  const int alphas = system_.layout().alpha_count;
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
  phi_factor_.topLeftCorner(phi, phi) = scale.asDiagonal() * eigen.vectors * inverse.asDiagonal() *
                                        eigen.vectors.transpose() * scale.asDiagonal();
  // Effects that change fast with distance leave the calibration a little off its optimum when the readings
  // are corrected anew. Scores speak of residuals at the optimum: its last step is taken to first order.
  Eigen::VectorXd pull = -system_.global_gradient();
  pull.tail(pull.size() - phi).setZero();
  const Eigen::VectorXd settled = system_.solve_stops(-system_.stop_gradient());
  const Eigen::VectorXd step = phi_factor_ * (pull - system_.couple(settled));
  const Signature moved = of_calibration(step, settled + system_.back_substitute(step, false));
  range_residual -= moved.range;
  if (!rows.pairs) bearing_residual -= moved.bearing;
}

void Projector::absorbed(const Signature& x, Eigen::VectorXd& phi, Eigen::VectorXd& stops) const {
  const JointLayout& layout = system_.layout();
  const Cells& c = problem_.cells;
  Eigen::VectorXd by_stop = Eigen::VectorXd::Zero(layout.coordinates);
  Eigen::VectorXd by_global = Eigen::VectorXd::Zero(layout.global_count);
  for (int i = 0; i < cells(); ++i) {
    const double range = range_information[i] * x.range[i], bearing = bearing_information[i] * x.bearing[i];
    double power = range;
    for (int a = 0; a < layout.alpha_count; ++a, power *= geometry_.d[i]) by_global[a] += power;
    const Eigen::Vector2d pull =
        range * slope_[i] * geometry_.n[i] + bearing / geometry_.axis_distance[i] * geometry_.t[i];
    by_global.segment<2>(layout.landmark_begin + 2 * c.landmark[i]) += pull;
    const int k = c.stop[i];
    const JointLayout::Node& node = layout.nodes[layout.node_of_stop[k]];
    if (node.free_position) by_stop.segment<2>(node.coordinate) -= pull;
    const int heading = node.heading[layout.slot_of_stop[k]];
    if (heading >= 0) by_stop[node.coordinate + heading] -= bearing;
  }
  const Eigen::VectorXd settled = system_.solve_stops(by_stop);
  phi = phi_factor_ * (by_global - system_.couple(settled));
  stops = settled + system_.back_substitute(phi, false);
}

Signature Projector::of_calibration(const Eigen::VectorXd& phi, const Eigen::VectorXd& stops) const {
  const JointLayout& layout = system_.layout();
  const Cells& c = problem_.cells;
  Signature x;
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
    for (int a = layout.alpha_count; a-- > 0;) curve = curve * geometry_.d[i] + phi[a];
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
  result.head(cells()) = range_information.cwiseProduct(x.range - taken.range);
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
  double sum = x.range.cwiseProduct(range_information).dot(range_residual) +
               x.bearing.cwiseProduct(bearing_information).dot(bearing_residual);
  if (x.within())
    sum += x.range_rows.cwiseProduct(row_range_information).dot(row_range_residual) +
           x.bearing_rows.cwiseProduct(row_bearing_information).dot(row_bearing_residual);
  return sum;
}

double Projector::raw_information(const Signature& x) const {
  double sum = x.range.cwiseAbs2().dot(range_information) + x.bearing.cwiseAbs2().dot(bearing_information);
  if (x.within())
    sum += x.range_rows.cwiseAbs2().dot(row_range_information) +
           x.bearing_rows.cwiseAbs2().dot(row_bearing_information);
  return sum;
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
  return x;
}

}  // namespace rangecal::diagnosis
