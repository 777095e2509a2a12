// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/natural_spline.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <utility>

#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// Q and R of Green and Silverman 1994, eq. 2.1-2.4: R c = Q^T g for the second derivatives c at the inner knots.
struct Bands {
  Eigen::MatrixXd Q, R;
  explicit Bands(const Eigen::VectorXd& t)
      : Q(Eigen::MatrixXd::Zero(t.size(), t.size() - 2)),
        R(Eigen::MatrixXd::Zero(t.size() - 2, t.size() - 2)) {
    for (Eigen::Index j = 0; j + 2 < t.size(); ++j) {
      const double before = t[j + 1] - t[j], behind = t[j + 2] - t[j + 1];
      Q(j, j) = 1.0 / before;
      Q(j + 1, j) = -1.0 / before - 1.0 / behind;
      Q(j + 2, j) = 1.0 / behind;
      R(j, j) = (before + behind) / 3.0;
      if (j + 3 < t.size()) R(j, j + 1) = R(j + 1, j) = behind / 6.0;
    }
  }
};

}  // namespace

bool NaturalSpline::are_knots(const Eigen::VectorXd& knots) {
  bool ascending = knots.size() >= 3 && knots.allFinite();
  for (Eigen::Index j = 0; ascending && j + 1 < knots.size(); ++j) ascending = knots[j] < knots[j + 1];
  return ascending;
}

NaturalSpline::NaturalSpline(Eigen::VectorXd knots, Eigen::VectorXd values)
    : knots_(std::move(knots)), values_(std::move(values)) {
  if (!are_knots(knots_)) throw InputError("a spline needs three knots or more, in ascending order");
  if (values_.size() != knots_.size() || !values_.allFinite())
    throw InputError("a spline needs one finite value for each of its knots");
  const Bands bands(knots_);
  curvatures_by_values_ = Eigen::MatrixXd::Zero(knots_.size(), knots_.size());
  curvatures_by_values_.middleRows(1, knots_.size() - 2) = bands.R.llt().solve(bands.Q.transpose());
  curvatures_ = curvatures_by_values_ * values_;
}

Eigen::MatrixXd NaturalSpline::bends() const {
  // With R = L L^T and B = Q (Q^T Q)^-1 L: Q^T B b = L b, and the roughness is (Q^T g)^T R^-1 (Q^T g).
  const Bands bands(knots_);
  const Eigen::MatrixXd L = bands.R.llt().matrixL();
  return bands.Q * (bands.Q.transpose() * bands.Q).llt().solve(L);
}

NaturalSpline::Place NaturalSpline::place(double x) const {
  const double* const behind = std::upper_bound(knots_.data() + 1, knots_.data() + knots_.size() - 1, x);
  const Eigen::Index left = behind - knots_.data() - 1;
  return {left, knots_[left + 1] - knots_[left], x - knots_[left], knots_[left + 1] - x};
}

Eigen::VectorXd NaturalSpline::weights(double x) const {
  const Eigen::MatrixXd& G = curvatures_by_values_;
  const double inside = std::clamp(x, knots_[0], knots_[knots_.size() - 1]);
  const auto [j, h, a, b] = place(inside);
  Eigen::VectorXd N = -a * b / 6.0 * ((1.0 + a / h) * G.row(j + 1) + (1.0 + b / h) * G.row(j)).transpose();
  N[j + 1] += a / h;
  N[j] += b / h;
  if (x == inside) return N;
  // Beyond an outer knot, whose second derivative is 0: straight on with the slope there.
  const double beyond = x - inside;
  N += beyond * h / 6.0 * (beyond < 0.0 ? Eigen::VectorXd(-G.row(j + 1)) : Eigen::VectorXd(G.row(j)));
  N[j + 1] += beyond / h;
  N[j] -= beyond / h;
  return N;
}

double NaturalSpline::slope_at_left(Eigen::Index j) const {
  const double h = knots_[j + 1] - knots_[j];
  return (values_[j + 1] - values_[j]) / h - h / 6.0 * (2.0 * curvatures_[j] + curvatures_[j + 1]);
}

double NaturalSpline::slope_at_right(Eigen::Index j) const {
  const double h = knots_[j + 1] - knots_[j];
  return (values_[j + 1] - values_[j]) / h + h / 6.0 * (curvatures_[j] + 2.0 * curvatures_[j + 1]);
}

double NaturalSpline::operator()(double x) const {
  const Eigen::Index last = knots_.size() - 1;
  if (x < knots_[0]) return values_[0] + (x - knots_[0]) * slope_at_left(0);
  if (x > knots_[last]) return values_[last] + (x - knots_[last]) * slope_at_right(last - 1);
  const auto [j, h, a, b] = place(x);
  return (a * values_[j + 1] + b * values_[j]) / h -
         a * b / 6.0 * ((1.0 + a / h) * curvatures_[j + 1] + (1.0 + b / h) * curvatures_[j]);
}

double NaturalSpline::slope(double x) const {
  const Eigen::Index last = knots_.size() - 1;
  const auto [j, h, a, b] = place(std::clamp(x, knots_[0], knots_[last]));
  return slope_at_left(j) + a * curvatures_[j] + 0.5 * a * a / h * (curvatures_[j + 1] - curvatures_[j]);
}

double NaturalSpline::curvature(double x) const {
  if (x < knots_[0] || x > knots_[knots_.size() - 1]) return 0.0;
  const auto [j, h, a, b] = place(x);
  return (a * curvatures_[j + 1] + b * curvatures_[j]) / h;
}

double NaturalSpline::least_slope() const {
  double least = slope_at_left(0);
  for (Eigen::Index j = 0; j + 1 < knots_.size(); ++j) {
    least = std::min(least, slope_at_right(j));
    const double left = curvatures_[j], right = curvatures_[j + 1];
    if (left < 0.0 && right > 0.0)
      least = std::min(least, slope(knots_[j] + (knots_[j + 1] - knots_[j]) * left / (left - right)));
  }
  return least;
}

double NaturalSpline::inverse(double value) const {
  const Eigen::Index last = knots_.size() - 1;
  if (value <= values_[0]) return knots_[0] + (value - values_[0]) / slope_at_left(0);
  if (value >= values_[last]) return knots_[last] + (value - values_[last]) / slope_at_right(last - 1);
  const Eigen::Index right =
      std::upper_bound(values_.data(), values_.data() + values_.size(), value) - values_.data();
  double low = knots_[right - 1], high = knots_[right];
  double x = low + (high - low) * (value - values_[right - 1]) / (values_[right] - values_[right - 1]);
  constexpr int most = 60;  // of steps by Newton, halvings where these leave the interval
  for (int step = 0; step < most; ++step) {
    const double off = operator()(x) - value;
    if (off == 0.0) return x;
    (off > 0.0 ? high : low) = x;
    double next = x - off / slope(x);
    if (!(next > low && next < high)) next = 0.5 * (low + high);
    if (std::abs(next - x) <= 4e-16 * std::abs(x)) return next;
    x = next;
  }
  return x;
}

}  // namespace rangecal
