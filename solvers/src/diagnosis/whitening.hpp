// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "diagnosis/rows.hpp"

namespace rangecal::diagnosis {

/// Makes the readings of a cell independent and of one variance. For y_i = mu + e_i in order of time, e an
/// AR(1) with correlation rho and variances s^2 m_i,
///   v_i = y_i / sqrt(m_i),   w_0 = v_0,   w_i = (v_i - rho v_{i-1}) / sqrt(1 - rho^2)
/// have the mean mu w(1)_i and variance s^2 each. Where m comes of a tail's law it is that of the weights at
/// the residuals, so that the score of a mean is the law's own.
struct Whitening {
  Eigen::VectorXd scale;  ///< 1 / sqrt(m_i) of every row; empty: all are 1
  double rho = 0.0;

  double scale_of(Eigen::Index row) const { return scale.size() > 0 ? scale[row] : 1.0; }
  bool is_identity() const { return scale.size() == 0 && rho == 0.0; }
  /// w of the rows of a cell from `begin` on.
  Eigen::VectorXd of_cell(Eigen::VectorXd values, int begin) const;
  /// ln |dy / dw| of all rows: what the NLL of y has over that of w.
  double log_jacobian(const Rows& rows) const;
};

/// Values by row taken apart: y = mean of its cell + what is left.
struct CellsAndRows {
  Eigen::VectorXd means;       ///< w(1)^T w(y) / w(1)^T w(1) of each cell
  Eigen::VectorXd weights;     ///< w(1)^T w(1): the mean has the variance s^2 / weight
  Eigen::VectorXd deviations;  ///< w(y) - mean w(1) of each row, in the unit of y, with variances below s^2
};
CellsAndRows split(const Rows& rows, const Eigen::VectorXd& values, const Whitening& whitening);

}  // namespace rangecal::diagnosis
