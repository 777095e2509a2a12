// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/landmarks/stop_prior.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>

#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

double inverse_or_zero(double sigma) { return sigma > 0.0 ? 1.0 / sigma : 0.0; }

}  // namespace

void set_covariance(const Eigen::Matrix3d& covariance, StopPrior& prior) {
  const Eigen::Matrix2d xy = covariance.topLeftCorner<2, 2>();
  prior.sigma_xy_m = std::sqrt(0.5 * xy.trace());
  prior.sigma_heading_rad = std::sqrt(covariance(2, 2));
  Eigen::Matrix3d Q = Eigen::Matrix3d::Identity();
  Q.topLeftCorner<2, 2>() = xy / (0.5 * xy.trace());
  Q.topRightCorner<2, 1>() = covariance.topRightCorner<2, 1>() *
                             (inverse_or_zero(prior.sigma_xy_m) * inverse_or_zero(prior.sigma_heading_rad));
  Q.bottomLeftCorner<1, 2>() = Q.topRightCorner<2, 1>().transpose();
  prior.shape = Q.isIdentity(1e-15) ? nullptr : std::make_shared<const Eigen::Matrix3d>(Q);
}

Eigen::Matrix3d covariance_of(const StopPrior& prior, double sigma_xy_m) {
  const Eigen::Vector3d D(sigma_xy_m, sigma_xy_m, prior.sigma_heading_rad);
  if (!prior.shape) return D.cwiseAbs2().asDiagonal();
  return D.asDiagonal() * *prior.shape * D.asDiagonal();
}

StopInformation::StopInformation(const StopPrior& prior, double sigma_xy_m)
    : position(prior.opens_place && sigma_xy_m > 0.0),
      heading(prior.sigma_heading_rad > 0.0),
      W(Eigen::Matrix3d::Zero()) {
  const double by_position = position ? 1.0 / sigma_xy_m : 0.0,
               by_heading = inverse_or_zero(prior.sigma_heading_rad);
  if (position) log_scale += 2.0 * (std::log(sigma_xy_m) + half_log_two_pi);
  if (heading) log_scale += std::log(prior.sigma_heading_rad) + half_log_two_pi;
  const Eigen::Vector3d D(by_position, by_position, by_heading);
  if (!prior.shape || !position) {
    W.diagonal() = D.cwiseAbs2();
    return;
  }
  const Eigen::Matrix3d& Q = *prior.shape;
  if (heading) {
    W = D.asDiagonal() * Q.inverse() * D.asDiagonal();
    log_scale += 0.5 * std::log(Q.determinant());
  } else {
    const Eigen::Matrix2d xy = Q.topLeftCorner<2, 2>();
    W.topLeftCorner<2, 2>() = by_position * by_position * xy.inverse();
    log_scale += 0.5 * std::log(xy.determinant());
  }
}

Eigen::Matrix3d StopInformation::root() const {
  Eigen::Matrix3d filled = W;  // ones where there is no prior, so that there is a factor
  if (!position) filled.topLeftCorner<2, 2>().setIdentity();
  if (!heading) filled(2, 2) = 1.0;
  Eigen::Matrix3d R = filled.llt().matrixU();
  if (!position) R.topRows<2>().setZero();
  if (!heading) R.row(2).setZero();
  return R;
}

Eigen::Vector3d stop_error(const StopPrior& prior, double sigma_xy_m, const Eigen::Vector3d& unit) {
  const Eigen::Vector3d D(sigma_xy_m, sigma_xy_m, prior.sigma_heading_rad);
  if (!prior.shape) return D.cwiseProduct(unit);
  return D.cwiseProduct(prior.shape->llt().matrixL() * unit);
}

void share_places(const std::vector<StopPrior>& priors, std::vector<Pose2>& stops) {
  std::vector<std::size_t> opener;
  for (std::size_t k = 0; k < stops.size(); ++k) {
    const auto place = static_cast<std::size_t>(priors[k].place);
    if (opener.size() <= place) opener.resize(place + 1, k);
    if (priors[k].opens_place) opener[place] = k;
    const std::size_t first = opener[place];
    if (first == k) continue;
    stops[k].x_m = stops[first].x_m + priors[k].commanded.x_m - priors[first].commanded.x_m;
    stops[k].y_m = stops[first].y_m + priors[k].commanded.y_m - priors[first].commanded.y_m;
  }
}

}  // namespace rangecal
