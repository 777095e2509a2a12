// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>

#include "diagnosis/serial_errors.hpp"

namespace rangecal::diagnosis {

/// What the readings along a sequence say of the part of their errors that wanders (SerialErrors), where their laws have tails. Before
/// a reading of error e_i [m] and spread s_i the part of e_i / s_i is taken for N(m_i, P_i). Then
///
///   z_i = (e_i / s_i - m_i) / sqrt(v_i),  v_i = P_i + 1 - q,  NLL = -sum (ln p_i(z_i) - ln(s_i sqrt(v_i)))
///
/// with p_i the law of z_i beside tails, and behind it, D_i and J_i being the slope of ln p_i and minus its second derivative, the
/// part has
///
///   mean m_i - P_i D_i / sqrt(v_i),  variance P_i - P_i^2 J_i / v_i.
///
/// Both are exact; that its law is normal again is the one approximation. Whatever the parameters are the NLL is of a density, a
/// product of one of every reading given those before it.
/// Source: Masreliez 1975.
class WanderingPart {
 public:
  WanderingPart(const Sequence& sequence, double q, double rho);

  struct Prediction {
    double mean, variance;        ///< m_i, P_i
    double error_variance = 1.0;  ///< v_i
    double correlation = 0.0;     ///< phi_i; 0 of the first of its device and group
    double spread() const { return std::sqrt(error_variance); }
    double variance_behind(double curvature) const {
      return std::max(0.0, (1.0 - variance / error_variance * curvature) * variance);
    }
    /// Mean and variance behind the reading, whose log density has the slope D_i and the curvature J_i.
    std::pair<double, double> behind(double slope, double curvature) const;
  };
  /// Of a row whose one before was read.
  Prediction before(int row) const;
  /// What the reading of a row leaves of the part.
  void leave(int row, double mean, double variance);
  /// What the row before it left.
  double mean_left(int row) const { return mean_[row]; }
  double variance_left(int row) const { return variance_[row]; }

 private:
  const Sequence& sequence_;
  double q_, rho_;
  Eigen::VectorXd mean_, variance_;  ///< of the part given the readings up to a row
};

}  // namespace rangecal::diagnosis
