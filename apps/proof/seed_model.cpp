// SPDX-License-Identifier: BSD-3-Clause
#include "seed_model.hpp"

#include <Eigen/QR>
#include <algorithm>
#include <cmath>
#include <map>
#include <string>

#include "rangecal/core/angles.hpp"

namespace rangecal::proof {
namespace {

constexpr double exact = 1e-6;  // [m] or [rad]: a spread this small holds its unknown

using Index = Eigen::Index;

void move(SeedState& state, const Eigen::VectorXd& step, bool alpha_held) {
  if (!alpha_held) state.alpha += step.head<3>();
  Index at = 3;
  for (Eigen::Vector2d& landmark : state.landmarks) landmark += step.segment<2>(at), at += 2;
  for (Eigen::Vector2d& place : state.places) place += step.segment<2>(at), at += 2;
  for (double& heading : state.headings) heading += step[at++];
}

}  // namespace

SeedModel::SeedModel(const world::World& clean) : clean_(clean), expected_(world::expected(clean)) {
  landmark_count_ = static_cast<int>(clean.landmarks.size());
  repeats_ = clean.timing.repeats;
  sigma_xy_ = std::max(exact, clean.robot.stated_sigma_m);
  sigma_heading_ = std::max(exact, clean.robot.stated_heading_sigma_rad);
  std::map<std::string, int> numbers;
  for (std::size_t k = 0; k < clean.robot.stops.size(); ++k) {
    const std::string& place = clean.robot.stops[k].place;
    place_of_.push_back(place.empty() ? place_count_
                                      : numbers.try_emplace(place, place_count_).first->second);
    if (place_of_.back() == place_count_) ++place_count_;
    for (int l = 0; l < landmark_count_; ++l)
      cell_stop_.push_back(static_cast<int>(k)), cell_landmark_.push_back(l);
  }
  range_sd_.assign(static_cast<std::size_t>(cells()), 0.0);
  bearing_sd_ = range_sd_;
  for (std::size_t i = 0; i < expected_.stop.size(); ++i) {
    const auto c = static_cast<std::size_t>(cell(expected_.stop[i], expected_.landmark[i]));
    range_sd_[c] += expected_.range_sd_m[i] / repeats_;
    bearing_sd_[c] += expected_.bearing_sd_rad[i] / repeats_;
  }
  state_ = start();
  state_ = fit(expected_).state;
  residual(expected_, state_, &jacobian_);
  const Eigen::VectorXd scale = jacobian_.colwise().norm().cwiseMax(1e-300);
  Eigen::ColPivHouseholderQR<Eigen::MatrixXd> qr(jacobian_ * scale.cwiseInverse().asDiagonal());
  qr.setThreshold(1e-10);
  basis_ = qr.householderQ() * Eigen::MatrixXd::Identity(jacobian_.rows(), qr.rank());
}

SeedState SeedModel::start() const {
  SeedState state;
  for (const world::Cylinder& landmark : clean_.landmarks)
    state.landmarks.emplace_back(landmark.x_m, landmark.y_m);
  state.places.assign(static_cast<std::size_t>(place_count_), Eigen::Vector2d::Zero());
  state.headings.assign(place_of_.size(), 0.0);
  return state;
}

Signal SeedModel::residual(const world::Expected& target, const SeedState& state,
                           Eigen::MatrixXd* jacobian) const {
  const Index n = cells(), stops = stop_count(), rows = static_cast<Index>(target.stop.size());
  const Index places_at = 3 + 2 * landmark_count_, headings_at = places_at + 2 * place_count_;
  Signal out;
  out.means = Eigen::VectorXd::Zero(2 * n + 2 * place_count_ + stops);
  out.rows = Eigen::VectorXd::Zero(2 * rows);
  if (jacobian) *jacobian = Eigen::MatrixXd::Zero(out.means.size(), headings_at + stops);
  Eigen::VectorXd predicted(2 * n), share = Eigen::VectorXd::Zero(n);
  const double root = std::sqrt(static_cast<double>(repeats_));
  for (Index c = 0; c < n; ++c) {
    const auto k = static_cast<std::size_t>(cell_stop_[static_cast<std::size_t>(c)]);
    const auto l = static_cast<std::size_t>(cell_landmark_[static_cast<std::size_t>(c)]);
    const Index p = place_of_[k];
    const Pose2& commanded = clean_.robot.stops[k].commanded;
    const Eigen::Vector2d stop =
        Eigen::Vector2d(commanded.x_m, commanded.y_m) + state.places[static_cast<std::size_t>(p)];
    const Eigen::Vector2d ray = state.landmarks[l] - stop;
    const double axis = ray.norm(), d = axis - clean_.landmarks[l].nominal_radius_m;
    const Eigen::Vector2d along = ray / axis, across(-along.y() / axis, along.x() / axis);
    predicted[c] = state.alpha[0] + d * (state.alpha[1] + d * state.alpha[2]);
    predicted[n + c] = std::atan2(ray.y(), ray.x()) - commanded.heading_rad - state.headings[k];
    if (!jacobian) continue;
    const double slope = state.alpha[1] + 2.0 * d * state.alpha[2];
    const double wr = root / range_sd_[static_cast<std::size_t>(c)];
    const double wb = root / bearing_sd_[static_cast<std::size_t>(c)];
    jacobian->row(c).head<3>() << wr, wr * d, wr * d * d;
    jacobian->row(c).segment<2>(3 + 2 * static_cast<Index>(l)) = wr * slope * along;
    jacobian->row(c).segment<2>(places_at + 2 * p) = -wr * slope * along;
    jacobian->row(n + c).segment<2>(3 + 2 * static_cast<Index>(l)) = wb * across;
    jacobian->row(n + c).segment<2>(places_at + 2 * p) = -wb * across;
    (*jacobian)(n + c, headings_at + static_cast<Index>(k)) = -wb;
  }
  for (Index i = 0; i < rows; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Index c = cell(target.stop[at], target.reported_landmark[at]);
    const auto cu = static_cast<std::size_t>(c);
    out.rows[i] = (target.range_mean_m[at] - predicted[c]) / range_sd_[cu];
    out.rows[rows + i] = wrap_angle(target.bearing_mean_rad[at] - predicted[n + c]) / bearing_sd_[cu];
    out.means[c] += out.rows[i], out.means[n + c] += out.rows[rows + i], share[c] += 1.0;
  }
  for (Index i = 0; i < rows; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Index c = cell(target.stop[at], target.reported_landmark[at]);
    out.rows[i] -= out.means[c] / share[c];
    out.rows[rows + i] -= out.means[n + c] / share[c];
  }
  out.means.head(2 * n) /= root;  // sum / R x sqrt(R)
  for (Index p = 0; p < place_count_; ++p) {
    out.means.segment<2>(place_row(static_cast<int>(p))) =
        -state.places[static_cast<std::size_t>(p)] / sigma_xy_;
    if (jacobian)
      jacobian->block<2, 2>(place_row(static_cast<int>(p)), places_at + 2 * p)
          .diagonal()
          .setConstant(1.0 / sigma_xy_);
  }
  for (Index k = 0; k < stops; ++k) {
    out.means[heading_row(static_cast<int>(k))] =
        -state.headings[static_cast<std::size_t>(k)] / sigma_heading_;
    if (jacobian) (*jacobian)(heading_row(static_cast<int>(k)), headings_at + k) = 1.0 / sigma_heading_;
  }
  return out;
}

SeedFit SeedModel::fit(const world::Expected& target, const Eigen::Vector3d* held_alpha) const {
  SeedFit best;
  best.state = state_;
  if (held_alpha) best.state.alpha = *held_alpha;
  Eigen::MatrixXd jacobian;
  best.residual = residual(target, best.state, &jacobian);
  for (int round = 0; round < 8; ++round) {
    if (held_alpha) jacobian.leftCols<3>().setZero();
    const Eigen::VectorXd scale = jacobian.colwise().norm().cwiseMax(1e-12);
    Eigen::MatrixXd normal = scale.cwiseInverse().asDiagonal() * (jacobian.transpose() * jacobian) *
                             scale.cwiseInverse().asDiagonal();
    normal.diagonal().array() += 1e-13;
    const Eigen::VectorXd gradient =
        scale.cwiseInverse().asDiagonal() * (jacobian.transpose() * best.residual.means);
    const Eigen::VectorXd step = scale.cwiseInverse().asDiagonal() * normal.ldlt().solve(gradient);
    const double before = best.residual.squared_norm();
    double length = 1.0;
    SeedFit next;
    for (int halving = 0; halving < 6; ++halving, length *= 0.5) {
      next.state = best.state;
      move(next.state, length * step, held_alpha != nullptr);
      next.residual = residual(target, next.state, &jacobian);
      if (next.residual.squared_norm() <= before) break;
    }
    const double after = next.residual.squared_norm();
    if (!(after <= before)) break;
    best = std::move(next);
    if (before - after < 1e-6 * (1.0 + after)) break;
  }
  return best;
}

Eigen::VectorXd SeedModel::project(const Eigen::VectorXd& means) const {
  return means - basis_ * (basis_.transpose() * means);
}

}  // namespace rangecal::proof
