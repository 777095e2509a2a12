// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <vector>

namespace rangecal::diagnosis {

/// Readings that follow one another: of every row the one before it, of the same device and group, and how far that is.
struct Sequence {
  std::vector<int> order;   ///< all rows, each behind the one before it
  std::vector<int> before;  ///< -1: the first of its device and group
  std::vector<double> gap;  ///< to the one before, the usual gap being 1
  bool empty() const { return order.empty(); }
  /// Readings that have one before them.
  int links() const;
  /// Of the rows `kept` (in rising order) alone: gaps across those that are left out add up.
  Sequence of(const std::vector<int>& kept) const;
};

/// Errors of readings in a sequence, part of which wanders from one to the next. In units of their standard deviations
///   e_i = sqrt(q) x_i + sqrt(1 - q) w_i,   x_i = phi_i x_before(i) + sqrt(1 - phi_i^2) v_i,   phi_i = rho^gap_i
/// with v, w independent N(0, 1): q [-] is the share of the variance that wanders, rho its correlation over the usual gap. The
/// one-step predictions of Kalman's filter make them independent: u = K e is N(0, I), K lower triangular in the order of
/// the sequence. Every operation costs one pass over the rows.
/// Beside tails (WanderingPart) the law of e_i given the readings before it has a Gaussian that stands for it, of weight w_i, and a
/// curvature J_i, both 1 where it is normal; e is then what remains of the errors less the shifts, times sqrt(w_i).
/// Source: Kalman 1960; Jones 1980 for gaps of any length; Masreliez 1975 beside tails.
class SerialErrors {
 public:
  /// The errors are independent: K = I.
  SerialErrors() = default;
  SerialErrors(const Sequence& sequence, double q, double rho);
  SerialErrors(const Sequence& sequence, double q, double rho, const Eigen::VectorXd& weight,
               const Eigen::VectorXd& curvature);

  bool independent() const { return phi_.empty(); }
  Eigen::VectorXd whitened(Eigen::VectorXd e) const;  ///< K e
  /// K E, all columns in one pass.
  using Columns = Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, Eigen::RowMajor>;
  Columns whitened_columns(Columns E) const;
  Eigen::VectorXd transposed(const Eigen::VectorXd& u) const;          ///< K^T u
  Eigen::VectorXd coloured(const Eigen::VectorXd& u) const;            ///< K^-1 u
  Eigen::VectorXd transpose_coloured(const Eigen::VectorXd& v) const;  ///< K^-T v
  /// ln of the standard deviation of the error of a row's one-step prediction.
  double log_spread(Eigen::Index row) const { return std::log(root_[static_cast<std::size_t>(row)]); }
  /// ln det of the errors' covariance, -2 ln det K.
  double log_determinant() const { return log_determinant_; }

 private:
  std::vector<int> order_, before_;
  std::vector<double> phi_, gain_;  ///< by row: phi_i, Kalman's gain
  std::vector<double> part_;        ///< of what wanders in e_i: sqrt(w_i)
  std::vector<double> root_;        ///< standard deviation of the prediction's error
  double log_determinant_ = 0.0;
};

}  // namespace rangecal::diagnosis
