// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/whitening.hpp"

#include <cmath>
#include <utility>

namespace rangecal::diagnosis {

Eigen::VectorXd Whitening::of_cell(Eigen::VectorXd values, int begin) const {
  if (scale.size() > 0) values = values.cwiseProduct(scale.segment(begin, values.size()));
  if (rho != 0.0) {
    const double root = std::sqrt(1.0 - rho * rho);
    for (Eigen::Index i = values.size() - 1; i > 0; --i) values[i] = (values[i] - rho * values[i - 1]) / root;
  }
  return values;
}

double Whitening::log_jacobian(const Rows& rows) const {
  double sum = 0.0;
  if (scale.size() > 0) sum -= scale.array().log().sum();
  if (rho != 0.0) sum += 0.5 * std::log(1.0 - rho * rho) * static_cast<double>(rows.size() - rows.cell_count);
  return sum;
}

CellsAndRows split(const Rows& rows, const Eigen::VectorXd& values, const Whitening& whitening) {
  CellsAndRows parts{Eigen::VectorXd(rows.cell_count), Eigen::VectorXd(rows.cell_count),
                     Eigen::VectorXd(values.size())};
  for (int c = 0; c < rows.cell_count; ++c) {
    const int begin = rows.cell_begin[c], count = rows.cell_begin[c + 1] - begin;
    if (count == 1) {
      const double scale = whitening.scale_of(begin);
      parts.weights[c] = scale * scale;
      parts.means[c] = values[begin];
      parts.deviations[begin] = 0.0;
      continue;
    }
    const auto of_cell = values.segment(begin, count);
    if (whitening.is_identity()) {
      parts.weights[c] = count;
      parts.means[c] = of_cell.mean();
      parts.deviations.segment(begin, count) = of_cell.array() - parts.means[c];
      continue;
    }
    const Eigen::VectorXd one = whitening.of_cell(Eigen::VectorXd::Ones(count), begin);
    const Eigen::VectorXd white = whitening.of_cell(of_cell, begin);
    parts.weights[c] = one.squaredNorm();
    parts.means[c] = one.dot(white) / parts.weights[c];
    parts.deviations.segment(begin, count) = white - parts.means[c] * one;
  }
  return parts;
}

}  // namespace rangecal::diagnosis
