// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/reference_distances.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>

#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {
namespace {

/// Ranges keep this share of their weight, a thousandfold spread, so that landmarks that no two lines of sight cross at have a
/// place, and one that is uncertain enough to be told.
constexpr double weight_left = 1e-6;
constexpr double well_known = 0.1;  ///< of d: its standard deviation

JointProblem without_ranges(JointProblem problem) {
  Cells& c = problem.cells;
  for (std::size_t i = 0; i < c.size(); ++i) {
    c.range_weight[i] *= weight_left;
    c.count[i] = 0.0;  // the log-determinant too: it would draw d to where s(d) is small
  }
  return problem;
}

JointFit by_bearings(const JointProblem& bearings, const JointState& state) {
  MarginalOptions options;
  options.held.alpha = options.held.sigmas = true;
  return solve_marginal(bearings, state, options);
}

/// The landmarks of a recording. Alpha and sigmas held, recordings have nothing in common.
struct OfRecording {
  int first = 0, count = 0;
};

std::vector<OfRecording> by_recording(const JointProblem& problem) {
  std::vector<OfRecording> all;
  for (int l = 0; l < problem.landmark_count(); ++l) {
    const auto r = static_cast<std::size_t>(problem.landmark_recording[l]);
    if (all.size() <= r) all.resize(r + 1);
    if (all[r].count++ == 0) all[r].first = l;
  }
  return all;
}

}  // namespace

ReferenceDistances::ReferenceDistances(const JointProblem& problem, const JointState& state)
    : bearings_(without_ranges(problem)),
      fit_(by_bearings(bearings_, state)),
      system_(bearings_, static_cast<int>(state.alpha.size()),
              static_cast<int>(state.noise.parameters.size())),
      distances_(problem.cells.size()) {
  if (fit_.outcome == Outcome::converged && fit_.covariance &&
      std::isfinite(system_.assemble(fit_.state, HessianKind::fisher)) && system_.eliminate())
    find_variances();
}

Eigen::Vector2d ReferenceDistances::sight(std::size_t cell) const {
  const Cells& c = bearings_.cells;
  const Pose2& pose = fit_.state.stops[static_cast<std::size_t>(c.stop[cell])];
  return fit_.state.landmarks[static_cast<std::size_t>(c.landmark[cell])] -
         Eigen::Vector2d(pose.x_m, pose.y_m);
}

void ReferenceDistances::find_variances() {
  const JointLayout& layout = system_.layout();
  const Cells& c = bearings_.cells;
  const std::vector<OfRecording> recordings = by_recording(bearings_);
  int most = 0;
  for (const OfRecording& one : recordings) most = std::max(most, one.count);
  // Column j: how the stops of every recording move along with coordinate j of its landmarks.
  Eigen::MatrixXd along(layout.coordinates, 2 * most);
  for (int j = 0; j < 2 * most; ++j) {
    Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout.global_count);
    for (const OfRecording& one : recordings)
      if (j < 2 * one.count) globals[layout.landmark_begin + 2 * one.first + j] = 1.0;
    along.col(j) = system_.back_substitute(globals, false);
  }
  for (std::size_t n = 0; n < layout.nodes.size(); ++n) {
    const JointLayout::Node& node = layout.nodes[n];
    if (node.landmarks.empty()) continue;
    const OfRecording& own =
        recordings[static_cast<std::size_t>(bearings_.landmark_recording[node.landmarks[0]])];
    const Eigen::Index begin = layout.landmark_begin + 2 * own.first, size = 2 * own.count;
    const auto C = fit_.covariance->block(begin, begin, size, size);
    Eigen::MatrixXd C_ms = Eigen::MatrixXd::Zero(size, 2);
    Eigen::Matrix2d C_ss = Eigen::Matrix2d::Zero();
    if (node.free_position) {
      const auto moves = along.block(node.coordinate, 0, 2, size);
      C_ms = C * moves.transpose();
      C_ss = moves * C_ms + system_.stop_covariance(static_cast<int>(n)).topLeftCorner<2, 2>();
    }
    for (const int k : node.stops)
      for (int cell = c.stop_begin[k]; cell < c.stop_begin[k + 1]; ++cell) {
        const auto i = static_cast<std::size_t>(cell);
        const Eigen::Index at = 2 * (c.landmark[i] - own.first);
        const Eigen::Vector2d to_landmark = sight(i), u = to_landmark.normalized();
        const Eigen::Matrix2d C_m = C_ms.middleRows<2>(at);
        const double d = to_landmark.norm() - c.radius_m[i],
                     variance = u.dot((C.block<2, 2>(at, at) - C_m - C_m.transpose() + C_ss) * u);
        if (d > 0.0 && variance >= 0.0 && variance < well_known * well_known * d * d)
          distances_[i] = Distance{d, variance};
      }
  }
}

double ReferenceDistances::variance_of_sum(const std::vector<double>& q) const {
  const JointLayout& layout = system_.layout();
  const Cells& c = bearings_.cells;
  Eigen::VectorXd by_global = Eigen::VectorXd::Zero(layout.global_count),
                  by_stop = Eigen::VectorXd::Zero(layout.coordinates);
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (!distances_[i]) continue;
    const Eigen::Vector2d u = sight(i).normalized();
    by_global.segment<2>(layout.landmark_begin + 2 * c.landmark[i]) += q[i] * u;
    const JointLayout::Node& node =
        layout.nodes[static_cast<std::size_t>(layout.node_of_stop[static_cast<std::size_t>(c.stop[i])])];
    if (node.free_position) by_stop.segment<2>(node.coordinate) -= q[i] * u;
  }
  if (by_global.isZero(0.0)) return 0.0;
  // (g, s)^T H^-1 (g, s) by the Schur complement of the stops.
  const Eigen::VectorXd of_stops = system_.solve_stops(by_stop);
  const Eigen::VectorXd left = by_global - system_.couple(of_stops);
  return by_stop.dot(of_stops) + left.dot(*fit_.covariance * left);
}

}  // namespace rangecal
