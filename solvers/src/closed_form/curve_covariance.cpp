// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/curve_covariance.hpp"

#include <Eigen/LU>
#include <cmath>

#include "closed_form/stop_variance.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

/// sum over the independent errors of the stops of E P E^T; `response`: of alpha to (x, y, heading) of every
/// stop.
MatrixXd by_stops(const JointProblem& problem, std::vector<MatrixXd> response,
                  std::optional<double> sigma_s_m) {
  const Eigen::Index p = response.empty() ? 0 : response[0].rows();
  MatrixXd covariance = MatrixXd::Zero(p, p);
  MatrixXd ahead = MatrixXd::Zero(p, 3);  // to the stop after this one, which a walk's error goes on to
  std::vector<MatrixXd> of_place(static_cast<std::size_t>(problem.place_count), MatrixXd::Zero(p, 2));
  for (std::size_t k = response.size(); k-- > 0;) {
    const StopPrior& prior = problem.stops[k];
    MatrixXd& own = response[k];
    const StopPrior* next = k + 1 < response.size() ? &problem.stops[k + 1] : nullptr;
    if (next && next->chained) {
      own.leftCols(2) += ahead.leftCols(2);
      if (next->turns_add_up) own.col(2) += ahead.col(2);
    }
    ahead = own;
    const double sigma_xy_m = prior.shape ? prior.sigma_xy_m : sigma_s_m.value_or(prior.sigma_xy_m);
    Matrix3d P = covariance_of(prior, sigma_xy_m);
    if (prior.chained && k > 0) {
      P = after_step(Matrix3d::Zero(), prior, sigma_xy_m, problem.stops[k - 1].commanded.heading_rad);
    } else if (!prior.opens_place) {  // its position is that of the stop that opens the place
      of_place[static_cast<std::size_t>(prior.place)] += own.leftCols(2);
      P.topRows(2).setZero();
      P.leftCols(2).setZero();
    } else {
      own.leftCols(2) += of_place[static_cast<std::size_t>(prior.place)];
    }
    covariance += own * P * own.transpose();
  }
  return covariance;
}

}  // namespace

MatrixXd curve_covariance(const JointProblem& problem, const std::vector<RangeSample>& samples,
                          const std::vector<CellWeights>& weights, const RangeModel& model,
                          double sigma_theta_rad, std::optional<double> sigma_s_m) {
  const Eigen::Index p = model.alpha.size();
  const auto landmarks = static_cast<std::size_t>(problem.landmark_count());
  struct At {
    VectorXd phi;
    Vector2d t;
    double slope, axis;
  };
  const auto at = [&](const RangeSample& s) {
    return At{powers_of(s.d, p),
              {-s.u.y(), s.u.x()},
              evaluate_derivative(model.alpha, s.d),
              s.d + problem.cells.radius_m[static_cast<std::size_t>(s.cell)]};
  };
  MatrixXd curve = MatrixXd::Zero(p, p);
  std::vector<MatrixXd> F(landmarks, MatrixXd::Zero(p, 2)), N(landmarks, MatrixXd::Zero(2, p));
  std::vector<Matrix2d> M(landmarks, Matrix2d::Zero());
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const RangeSample& s = samples[i];
    const CellWeights& w = weights[i];
    const At a = at(s);
    curve += w.curve * a.phi * a.phi.transpose();
    F[s.landmark] += w.curve * a.slope * a.phi * s.u.transpose();
    M[s.landmark] += w.across * a.t * a.t.transpose() + w.along * s.u * s.u.transpose();
    if (w.along > 0.0 && !w.raw) N[s.landmark] += w.along / a.slope * s.u * a.phi.transpose();
  }
  std::vector<MatrixXd> K(landmarks, MatrixXd::Zero(p, 2));
  for (std::size_t l = 0; l < landmarks; ++l) {
    if (!(M[l].determinant() > 0.0)) continue;  // not placed: none of its cells is a sample
    K[l] = F[l] * M[l].inverse();
    curve -= K[l] * N[l];
  }
  MatrixXd own = MatrixXd::Zero(p, p);  // of the readings' errors
  std::vector<MatrixXd> response(problem.stops.size(), MatrixXd::Zero(p, 3));
  for (std::size_t i = 0; i < samples.size(); ++i) {
    const RangeSample& s = samples[i];
    const CellWeights& w = weights[i];
    const At a = at(s);
    const double spread = model.noise.spread(s.d, evaluate_polynomial(model.alpha, s.d));
    VectorXd of_range = w.curve * a.phi;
    if (w.along > 0.0) of_range -= w.along / (w.raw ? 1.0 : a.slope) * K[s.landmark] * s.u;
    const VectorXd of_bearing = w.across * a.axis * K[s.landmark] * a.t;
    own += (spread * spread * of_range * of_range.transpose() +
            sigma_theta_rad * sigma_theta_rad * of_bearing * of_bearing.transpose()) /
           s.R;
    MatrixXd& of_stop =
        response[static_cast<std::size_t>(problem.cells.stop[static_cast<std::size_t>(s.cell)])];
    of_stop.leftCols(2) +=
        K[s.landmark] * (w.across * a.t * a.t.transpose() + w.along * s.u * s.u.transpose()) -
        w.curve * a.slope * a.phi * s.u.transpose();
    of_stop.col(2) += of_bearing;
  }
  const MatrixXd T = curve.inverse();
  return T * (own + by_stops(problem, std::move(response), sigma_s_m)) * T.transpose();
}

}  // namespace rangecal
