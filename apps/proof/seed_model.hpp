// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "rangecal/problems/world/physical/simulate.hpp"

namespace rangecal::proof {

/// What the seed model says of a world: the curve, the landmarks, the errors of places and headings.
struct SeedState {
  Eigen::Vector3d alpha{0.0, 1.0, 0.0};  ///< f(d) = alpha_0 + alpha_1 d + alpha_2 d^2
  std::vector<Eigen::Vector2d> landmarks;
  std::vector<Eigen::Vector2d> places;  ///< position error of each place [m]
  std::vector<double> headings;         ///< heading error of each stop [rad]
};

/// Whitened readings: cell means (range, bearing; each divided by its standard deviation) followed by the priors
/// of places and headings, and the rows' deviations from their cell means (range rows, then bearing rows).
struct Signal {
  Eigen::VectorXd means, rows;
  double squared_norm() const { return means.squaredNorm() + rows.squaredNorm(); }
};

struct SeedFit {
  SeedState state;
  Signal residual;  ///< noise-free readings minus the seed model's best account of them
};

/// The seed model of one design, written anew for the proof: it shares no code with the diagnosis.
///
///   r = f(d) + e,  d = |l - s| - R,     b = atan2(l - s) - phi + nu,
///   s = commanded + place error, N(0, sigma_xy^2) each,  phi = commanded + N(0, sigma_h^2)
///
/// Spreads are those of the clean world; sigma_xy, sigma_h as stated, at least 1e-6 (exact).
class SeedModel {
 public:
  explicit SeedModel(const world::World& clean);

  /// The best account of noise-free readings, by damped Gauss-Newton; `held_alpha`: the curve is given.
  SeedFit fit(const world::Expected& target, const Eigen::Vector3d* held_alpha = nullptr) const;
  /// Whitened derivatives of the means by (alpha, landmarks, places, headings) at the clean world.
  const Eigen::MatrixXd& jacobian() const { return jacobian_; }
  /// x without what the calibration absorbs: (I - Q Q^T) x for the means.
  Eigen::VectorXd project(const Eigen::VectorXd& means) const;

  const world::World& clean() const { return clean_; }
  const world::Expected& expected() const { return expected_; }
  const SeedState& state() const { return state_; }
  int cells() const { return static_cast<int>(cell_stop_.size()); }
  int cell(int stop, int landmark) const { return stop * landmark_count_ + landmark; }
  int repeats() const { return repeats_; }
  int place_count() const { return place_count_; }
  int place(int stop) const { return place_of_[static_cast<std::size_t>(stop)]; }
  int stop_count() const { return static_cast<int>(place_of_.size()); }
  int landmark_count() const { return landmark_count_; }
  double sigma_xy_m() const { return sigma_xy_; }
  double sigma_heading_rad() const { return sigma_heading_; }
  double range_sd_m(int c) const { return range_sd_[static_cast<std::size_t>(c)]; }  ///< of one reading
  double bearing_sd_rad(int c) const { return bearing_sd_[static_cast<std::size_t>(c)]; }
  /// Rows of `means` where places and headings begin.
  int place_row(int place) const { return 2 * cells() + 2 * place; }
  int heading_row(int stop) const { return 2 * cells() + 2 * place_count_ + stop; }

 private:
  Signal residual(const world::Expected& target, const SeedState& state, Eigen::MatrixXd* jacobian) const;
  SeedState start() const;

  world::World clean_;
  world::Expected expected_;
  int landmark_count_ = 0, repeats_ = 0, place_count_ = 0;
  double sigma_xy_ = 0.01, sigma_heading_ = 1e-6;
  std::vector<int> cell_stop_, cell_landmark_, place_of_;
  std::vector<double> range_sd_, bearing_sd_;
  SeedState state_;
  Eigen::MatrixXd jacobian_, basis_;
};

}  // namespace rangecal::proof
