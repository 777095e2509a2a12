// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/residual_spread.hpp"

#include <algorithm>
#include <cmath>

#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

/// What the cells of one stop, or of one landmark, have in common: their columns U of Omega.
struct SharedError {
  Matrix2d covariance = Matrix2d::Identity();  ///< of the two columns
  MatrixXd with_gain;                          ///< U^T G
  Matrix2d own = Matrix2d::Zero();             ///< U^T V^-1 U
  MatrixXd with_curve;                         ///< U^T V^-1 B, B = (H, Omega G)
};

}  // namespace

// M Omega M^T = D + U C U^T + B S B^T with D diagonal, B = (H, Omega G) and S = [[Z, -I], [-I, 0]], Z = G^T Omega G. So
// tr(T T) is the sum of squares over pairs of these parts.
double residual_spread(const std::vector<RangeSample>& samples,
                       const std::vector<Matrix2d>& landmark_covariance, const VectorXd& alpha,
                       const MatrixXd& gain, const std::vector<MomentTerm>& terms, double dof_within,
                       double x) {
  const Eigen::Index p = alpha.size(), count = static_cast<Eigen::Index>(samples.size());
  int last_stop = 0, last_landmark = 0;
  for (const RangeSample& s : samples) {
    last_stop = std::max(last_stop, s.stop);
    last_landmark = std::max(last_landmark, s.landmark);
  }
  const SharedError none{Matrix2d::Identity(), MatrixXd::Zero(2, p), Matrix2d::Zero(),
                         MatrixXd::Zero(2, 2 * p)};
  std::vector<SharedError> stops(static_cast<std::size_t>(last_stop) + 1, none);
  std::vector<SharedError> landmarks(static_cast<std::size_t>(last_landmark) + 1, none);
  for (std::size_t l = 0; l < landmarks.size(); ++l)
    landmarks[l].covariance = landmark_covariance.empty() ? Matrix2d::Zero() : landmark_covariance[l];
  struct Cell {
    SharedError &stop, &landmark;
    Vector2d of_stop, of_landmark;  ///< its row of U
    double alone;                   ///< D
  };
  const auto cell = [&](std::size_t i) {
    const RangeSample& s = samples[i];
    const double slope = evaluate_derivative(alpha, s.d);
    const Vector2d sight = slope * s.u;
    return Cell{stops[static_cast<std::size_t>(s.stop)], landmarks[static_cast<std::size_t>(s.landmark)],
                std::sqrt(s.d_variance) * sight, sight,
                x * terms[i].scale + slope * slope * s.d_variance * (1.0 - s.u.squaredNorm())};
  };
  for (Eigen::Index i = 0; i < count; ++i) {
    const Cell c = cell(static_cast<std::size_t>(i));
    c.stop.with_gain.noalias() += c.of_stop * gain.row(i);
    c.landmark.with_gain.noalias() += c.of_landmark * gain.row(i);
  }
  MatrixXd omega_gain(p, count), Z = MatrixXd::Zero(p, p);  // one column per cell
  for (Eigen::Index i = 0; i < count; ++i) {
    const Cell c = cell(static_cast<std::size_t>(i));
    omega_gain.col(i) = c.alone * gain.row(i).transpose() + c.stop.with_gain.transpose() * c.of_stop +
                        c.landmark.with_gain.transpose() * (c.landmark.covariance * c.of_landmark);
    Z.noalias() += gain.row(i).transpose() * omega_gain.col(i).transpose();
  }
  MatrixXd S = MatrixXd::Zero(2 * p, 2 * p);
  S.topLeftCorner(p, p) = Z;
  S.topRightCorner(p, p).diagonal().setConstant(-1.0);
  S.bottomLeftCorner(p, p).diagonal().setConstant(-1.0);

  double trace = 0.0, fall = dof_within / x;
  MatrixXd curve = MatrixXd::Zero(2 * p, 2 * p);  // B^T V^-1 B
  VectorXd b(2 * p);
  for (Eigen::Index i = 0; i < count; ++i) {
    const auto at = static_cast<std::size_t>(i);
    const Cell c = cell(at);
    const double V = x * terms[at].scale + terms[at].other, root = std::sqrt(V);
    b << powers_of(samples[at].d, p) / root, omega_gain.col(i) / root;
    const Vector2d of_stop = c.of_stop / root, of_landmark = c.of_landmark / root;
    const double by_stop = of_stop.squaredNorm(),
                 by_landmark = of_landmark.dot(c.landmark.covariance * of_landmark);
    const double alone = c.alone / V, rest = by_stop + by_landmark + b.dot(S * b);
    trace += alone * (alone + 2.0 * rest) + 2.0 * by_stop * by_landmark;
    fall += (alone + rest) * terms[at].scale / V;
    curve.noalias() += b * b.transpose();
    c.stop.own += of_stop * of_stop.transpose();
    c.stop.with_curve.noalias() += of_stop * b.transpose();
    c.landmark.own += of_landmark * of_landmark.transpose();
    c.landmark.with_curve.noalias() += of_landmark * b.transpose();
  }
  const MatrixXd by_curve = S * curve;
  trace += (by_curve * by_curve).trace();
  for (const std::vector<SharedError>* all : {&stops, &landmarks})
    for (const SharedError& e : *all) {
      const Matrix2d own = e.covariance * e.own;
      trace +=
          (own * own).trace() + 2.0 * (e.covariance * e.with_curve * S * e.with_curve.transpose()).trace();
    }
  return std::sqrt(2.0 * (trace + dof_within)) / fall;
}

}  // namespace rangecal
