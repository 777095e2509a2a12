// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/last_pose.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Geometry>
#include <cmath>

namespace rangecal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// Where x, y and the heading of a node's stop stand among the coordinates of all stops, as far as they are
/// free.
std::vector<int> coordinates_of(const JointLayout::Node& node, int heading) {
  std::vector<int> all;
  if (node.free_position) all = {node.coordinate, node.coordinate + 1};
  if (heading >= 0) all.push_back(node.coordinate + heading);
  return all;
}
std::vector<int> first_coordinates(const JointLayout& layout) {
  return coordinates_of(layout.nodes.front(), layout.nodes.front().heading.front());
}

/// The columns of H^-1 of these coordinates.
MatrixXd inverse_columns(const JointSystem& system, const std::vector<int>& coordinates) {
  MatrixXd columns(system.layout().coordinates, static_cast<Index>(coordinates.size()));
  for (Index i = 0; i < columns.cols(); ++i) {
    const int at = coordinates[static_cast<std::size_t>(i)];
    columns.col(i) = system.solve_stops(VectorXd::Unit(system.layout().coordinates, at));
  }
  return columns;
}

/// (H^-1 G)_u over phi, from the columns of H^-1 of u.
MatrixXd coupling_of(const JointSystem& system, const MatrixXd& columns) {
  MatrixXd rows(columns.cols(), system.layout().phi_count);
  for (Index i = 0; i < columns.cols(); ++i)
    rows.row(i) = system.couple(columns.col(i)).head(system.layout().phi_count).transpose();
  return rows;
}

VectorXd coordinates_in(const Pose2& pose, bool position, bool heading) {
  VectorXd u((position ? 2 : 0) + (heading ? 1 : 0));
  if (position) u.head<2>() << pose.x_m, pose.y_m;
  if (heading) u[u.size() - 1] = pose.heading_rad;
  return u;
}

}  // namespace

Pose2 LastPose::pose(const VectorXd& u) const {
  Pose2 pose = exact;
  if (free_position) {
    pose.x_m = u[0];
    pose.y_m = u[1];
  }
  if (free_heading) pose.heading_rad = u[u.size() - 1];
  return pose;
}

LastPose LastPose::at(const VectorXd& weights) const {
  LastPose one = *this;
  one.mean = {weights[0] * mean[0]};
  one.slope = {weights[0] * slope[0]};
  one.covariance = {weights[0] * covariance[0]};
  for (std::size_t q = 1; q < mean.size(); ++q) {
    const double w = weights[static_cast<Index>(q)];
    one.mean[0] += w * mean[q];
    one.slope[0] += w * slope[q];
    one.covariance[0] += w * covariance[q];
  }
  return one;
}

LastPose LastPose::moved(const VectorXd& delta) const {
  LastPose there = *this;
  MatrixXd turned = MatrixXd::Zero(slope[0].rows(), slope[0].cols());
  for (std::size_t i = 0; i < bend.size(); ++i) {
    turned += delta[static_cast<Index>(i)] * turn[i];
    there.covariance[0] += delta[static_cast<Index>(i)] * bend[i];
  }
  there.mean[0] += (slope[0] + 0.5 * turned) * delta.head(turned.cols());
  there.slope[0] += turned;
  return there;
}

void LastPose::grow(Index phis) {
  const auto wider = [&](MatrixXd& B) {
    const Index before = B.cols();
    B.conservativeResize(Eigen::NoChange, phis);
    B.rightCols(phis - before).setZero();
  };
  for (MatrixXd& B : slope) wider(B);
  for (MatrixXd& E : turn) wider(E);
  turn.resize(static_cast<std::size_t>(phis), MatrixXd::Zero(dim(), phis));
  bend.resize(static_cast<std::size_t>(phis), MatrixXd::Zero(dim(), dim()));
}

namespace {

/// `pose` moved with the body that moves from `from` to `to`.
Pose2 moved(const Pose2& pose, const Pose2& from, const Pose2& to) {
  const double turn = to.heading_rad - from.heading_rad;
  const Eigen::Vector2d away =
      Eigen::Rotation2Dd(turn) * Eigen::Vector2d(pose.x_m - from.x_m, pose.y_m - from.y_m);
  return {to.x_m + away.x(), to.y_m + away.y(), pose.heading_rad + turn};
}

}  // namespace

std::vector<Pose2> commanded_from(const JointProblem& problem, const Pose2& first) {
  std::vector<Pose2> poses;
  for (const StopPrior& stop : problem.stops)
    poses.push_back(moved(stop.commanded, problem.stops[0].commanded, first));
  return poses;
}

Pose2 commanded_step(const JointProblem& problem, const Pose2& from, std::size_t k) {
  return moved(problem.stops[k].commanded, problem.stops[k - 1].commanded, from);
}

WalkStart::WalkStart(JointProblem& problem, const LastPose& law, const VectorXd& reference)
    : problem_(problem), law_(law), reference_(reference) {
  for (const StopPrior& stop : problem.stops) commanded_.push_back(stop.commanded);
}

bool WalkStart::set(const VectorXd& weights, const VectorXd& phi) {
  now_ = law_.at(weights).moved(phi - reference_);
  const MatrixXd& C = now_.covariance[0];
  const Eigen::LLT<MatrixXd> factor(C);
  if (factor.info() != Eigen::Success || !now_.mean[0].allFinite()) return false;
  information_ = factor.solve(MatrixXd::Identity(C.rows(), C.cols()));
  StopPrior& prior = problem_.stops[0];
  if (law_.free_position) {
    Eigen::Matrix3d whole = Eigen::Matrix3d::Zero();
    whole.topLeftCorner(C.rows(), C.cols()) = C;
    set_covariance(whole, prior);
  } else if (law_.free_heading) {
    prior.sigma_heading_rad = std::sqrt(C(0, 0));
  }
  for (std::size_t k = 0; k < commanded_.size(); ++k)
    problem_.stops[k].commanded = moved(commanded_[k], commanded_[0], now_.pose(now_.mean[0]));
  return true;
}

WalkStart::Share WalkStart::share(const JointSystem& system, const JointState& state) const {
  const std::vector<int> own = first_coordinates(system.layout());
  const MatrixXd columns = inverse_columns(system, own), U = coupling_of(system, columns);
  const MatrixXd C_uu = columns(own, Eigen::all), &B = now_.slope[0], WB = pull();
  const VectorXd off = coordinates_in(state.stops[0], law_.free_position, law_.free_heading) - now_.mean[0],
                 pulled = information_ * off;
  const MatrixXd cross = WB.transpose() * U, WCW = information_ * C_uu * information_;
  Share share{-B.transpose() * pulled, VectorXd::Zero(B.cols()),
              B.transpose() * WB - WB.transpose() * C_uu * WB + cross + cross.transpose()};
  for (Index i = 0; i < B.cols(); ++i) {
    const MatrixXd& D = law_.bend[static_cast<std::size_t>(i)];
    share.gradient[i] += 0.5 * (information_.cwiseProduct(D).sum() - pulled.dot(D * pulled));
    share.log_det_gradient[i] = -0.5 * WCW.cwiseProduct(D).sum();
    share.schur.row(i) -= pulled.transpose() * law_.turn[static_cast<std::size_t>(i)];
  }
  return share;
}

LastPose law_of_last(const JointSystem& system, const JointState& state, const WalkStart* start) {
  const JointLayout& layout = system.layout();
  const JointLayout::Node& node = layout.nodes.back();
  const std::vector<int> own = coordinates_of(node, node.heading.back());
  const MatrixXd columns = inverse_columns(system, own);
  LastPose law;
  law.free_position = node.free_position;
  law.free_heading = node.heading.back() >= 0;
  law.exact = state.stops.back();
  law.mean = {coordinates_in(state.stops.back(), law.free_position, law.free_heading)};
  law.slope = {-coupling_of(system, columns)};
  if (start) law.slope[0] += columns(first_coordinates(layout), Eigen::all).transpose() * start->pull();
  law.covariance = {columns(own, Eigen::all)};
  return law;
}

}  // namespace rangecal
