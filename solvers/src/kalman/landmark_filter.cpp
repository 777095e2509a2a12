// SPDX-License-Identifier: BSD-3-Clause
#include "kalman/landmark_filter.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cmath>
#include <optional>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

// Innovations beyond farthest_followed standard deviations leave the state alone, for the linearisation does not hold there; beyond
// farthest_counted the reading is of no use, since its square overflows.
constexpr double farthest_followed = 1e3, farthest_counted = 1e100;

}  // namespace

LandmarkFilter::LandmarkFilter(const Calibration& of) : reference(of) {
  const Index alphas = reference.alpha.size();
  x = VectorXd::Zero(alphas + 3);
  x.head(alphas) = reference.alpha;
  P = MatrixXd::Zero(x.size(), x.size());
  if (reference.alpha_covariance) P.topLeftCorner(alphas, alphas) = *reference.alpha_covariance;
}

Matrix3d LandmarkFilter::start(const Pose2& now, const Matrix3d& covariance, bool walk, bool turned) {
  const Index at = pose();
  Matrix3d F = Matrix3d::Zero(), own = covariance;
  if (turned) {
    own.topLeftCorner<2, 2>().setZero();
    F(0, 0) = F(1, 1) = 1.0;
    F(2, 2) = walk ? 1.0 : 0.0;
    x[at + 2] = now.heading_rad + (walk ? x[at + 2] - commanded.heading_rad : 0.0);
  } else if (walk) {
    const double h = x[at + 2];
    const Vector2d step = Eigen::Rotation2Dd(h - commanded.heading_rad) *
                          Vector2d(now.x_m - commanded.x_m, now.y_m - commanded.y_m);
    F.setIdentity();
    F.topRightCorner<2, 1>() = Vector2d(-step.y(), step.x());
    Matrix3d turn = Matrix3d::Identity();
    turn.topLeftCorner<2, 2>() = Eigen::Rotation2Dd(h).toRotationMatrix();
    own = turn * covariance * turn.transpose();
    x.segment<2>(at) += step;
    x[at + 2] += now.heading_rad - commanded.heading_rad;
  } else {
    x.segment<3>(at) << now.x_m, now.y_m, now.heading_rad;
  }
  P.middleRows<3>(at) = (F * P.middleRows<3>(at)).eval();
  P.middleCols<3>(at) = (P.middleCols<3>(at) * F.transpose()).eval();
  P.block<3, 3>(at, at) += own;
  commanded = now;
  return F;
}

bool LandmarkFilter::update(Innovation& read) {
  const VectorXd cross = P * read.row;
  read.S = read.row.dot(cross) + read.noise;
  const double off = std::abs(read.nu), sigma = std::sqrt(read.S);
  if (!(off < farthest_counted * sigma && std::isfinite(sigma))) return false;
  if (off > farthest_followed * sigma) {
    read.gain = VectorXd::Zero(x.size());
    return true;
  }
  read.gain = cross / read.S;
  x += read.gain * read.nu;
  P.noalias() -= read.gain * cross.transpose();
  return true;
}

LandmarkFilter::Taken LandmarkFilter::take(const std::string& landmark, double radius, double range_m,
                                           double bearing_rad) {
  const auto known = std::find(labels.begin(), labels.end(), landmark);
  if (known == labels.end()) return place(landmark, radius, range_m, bearing_rad);
  const Index alphas = pose(), l = known - labels.begin(), at = alphas + 3 + 2 * l;
  Taken taken;
  const VectorXd alpha = x.head(alphas);
  const Vector2d sight = x.segment<2>(at) - x.segment<2>(alphas);
  const double D = sight.norm();
  taken.d = D - radius_m[static_cast<std::size_t>(l)];
  taken.f = evaluate_polynomial(alpha, taken.d);
  taken.s = reference.noise.spread(taken.d, taken.f);
  if (!(taken.d > 0.0 && taken.s > 0.0 && std::abs(range_m - taken.f) < farthest_counted * taken.s))
    return taken;
  const Vector2d n = sight / D, across = Vector2d(-n.y(), n.x()) / D;
  const double slope = evaluate_derivative(alpha, taken.d), sigma = reference.sigma_theta_rad->value;
  taken.bearing.row = taken.range.row = VectorXd::Zero(x.size());
  taken.bearing.row.segment<2>(at) = across;
  taken.bearing.row.segment<2>(alphas) = -across;
  taken.bearing.row[alphas + 2] = -1.0;
  taken.range.row.head(alphas) = powers_of(taken.d, alphas);
  taken.range.row.segment<2>(at) = slope * n;
  taken.range.row.segment<2>(alphas) = -slope * n;
  taken.bearing.noise = sigma * sigma;
  taken.range.noise = taken.s * taken.s;
  taken.bearing.nu = wrap_angle(bearing_rad - std::atan2(sight.y(), sight.x()) + x[alphas + 2]);
  const VectorXd before = x;
  if (!update(taken.bearing)) return taken;
  taken.range.nu = range_m - taken.f - taken.range.row.dot(x - before);
  taken.usable = update(taken.range);
  return taken;
}

LandmarkFilter::Taken LandmarkFilter::place(const std::string& landmark, double radius, double range_m,
                                            double bearing_rad) {
  const Index alphas = pose(), size = x.size();
  Taken taken;
  const VectorXd alpha = x.head(alphas);
  const std::optional<double> d = invert_near(alpha, range_m);
  if (!d) return taken;  // the landmark stays unknown, the next reading of it may place it
  taken.d = *d;
  taken.f = range_m;
  taken.s = reference.noise.spread(taken.d, taken.f);
  if (!(taken.s > 0.0)) return taken;
  const double direction = x[alphas + 2] + bearing_rad, D = *d + radius,
               sigma = reference.sigma_theta_rad->value;
  const Vector2d n(std::cos(direction), std::sin(direction)), across = D * Vector2d(-n.y(), n.x());
  taken.by_range = n / evaluate_derivative(alpha, *d);
  taken.by_state = Eigen::Matrix2Xd::Zero(2, size);
  taken.by_state.leftCols(alphas) = -taken.by_range * powers_of(*d, alphas).transpose();
  taken.by_state.middleCols<2>(alphas).setIdentity();
  taken.by_state.col(alphas + 2) = across;
  const Eigen::Matrix2Xd cross = taken.by_state * P;
  const Eigen::Matrix2d own = cross * taken.by_state.transpose() +
                              taken.s * taken.s * taken.by_range * taken.by_range.transpose() +
                              sigma * sigma * across * across.transpose();
  if (!cross.allFinite() || !own.allFinite()) return taken;
  taken.usable = taken.placed = true;
  x.conservativeResize(size + 2);
  x.tail<2>() = x.segment<2>(alphas) + D * n;
  P.conservativeResize(size + 2, size + 2);
  P.bottomLeftCorner(2, size) = cross;
  P.topRightCorner(size, 2) = cross.transpose();
  P.bottomRightCorner<2, 2>() = own;
  labels.push_back(landmark);
  radius_m.push_back(radius);
  return taken;
}

}  // namespace rangecal
