// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/length_interval.hpp"

#include <Eigen/Cholesky>
#include <Eigen/Eigenvalues>
#include <algorithm>
#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "rangecal/core/distributions.hpp"

namespace rangecal::diagnosis {
namespace {

/// The vector of length r that makes x likeliest: the least of (x - r u)^T C^-1 (x - r u) over unit vectors
/// u.
Eigen::Vector2d likeliest(double r, const Eigen::Vector2d& x, const Eigen::Matrix2d& C) {
  const Eigen::LLT<Eigen::Matrix2d> factor(C);
  const auto at = [&](double angle) -> Eigen::Vector2d { return {r * std::cos(angle), r * std::sin(angle)}; };
  const auto distance = [&](double angle) { return factor.matrixL().solve(x - at(angle)).squaredNorm(); };
  constexpr int directions = 72;
  double best = std::atan2(x.y(), x.x()), least = distance(best), width = 2.0 * std::numbers::pi / directions;
  const double home = best;
  for (int i = 1; i < directions; ++i) {
    const double value = distance(home + i * width);
    if (value < least) least = value, best = home + i * width;
  }
  for (; width > 1e-9; width *= 0.5)
    for (const double angle : {best - width, best + width})
      if (const double value = distance(angle); value < least) least = value, best = angle;
  return at(best);
}

/// The length at which `below(length)` falls through `level`; it decreases from `from` on.
template <typename Below>
double crossing(const Below& below, double level, double from, double step) {
  double low = from, high = from + step, at_low = below(low) - level, at_high = below(high) - level;
  for (int i = 0; i < 60 && at_high > 0.0; ++i)
    low = high, at_low = at_high, high += step, at_high = below(high) - level;
  if (!(at_low > 0.0)) return low;
  if (!(at_high < 0.0)) return high;
  std::uintmax_t evaluations = 60;
  const auto [left, right] =
      boost::math::tools::toms748_solve([&](double x) { return below(x) - level; }, low, high, at_low,
                                        at_high, boost::math::tools::eps_tolerance<double>(35), evaluations);
  return 0.5 * (left + right);
}

}  // namespace

double probability_within(double R, const Eigen::Vector2d& mu, const Eigen::Matrix2d& C) {
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix2d> axes(C);
  const Eigen::Vector2d s = axes.eigenvalues().cwiseMax(0.0).cwiseSqrt(),
                        m = axes.eigenvectors().transpose() * mu;
  if (!(s.x() > 0.0)) return mu.norm() <= R ? 1.0 : 0.0;
  // Along the wider axis u by Simpson's rule, u = R sin t where the circle bounds it; the other axis in
  // closed form.
  const double low = std::max(-R, m.y() - 9.0 * s.y()), high = std::min(R, m.y() + 9.0 * s.y());
  if (!(low < high)) return 0.0;
  const double from = std::asin(std::clamp(low / R, -1.0, 1.0)),
               to = std::asin(std::clamp(high / R, -1.0, 1.0));
  constexpr int panels = 400;
  const double h = (to - from) / panels;
  double sum = 0.0;
  for (int i = 0; i <= panels; ++i) {
    const double t = from + i * h, u = R * std::sin(t), half = R * std::cos(t), z = (u - m.y()) / s.y();
    const double density = std::exp(-0.5 * z * z) / (s.y() * std::sqrt(2.0 * std::numbers::pi));
    const double across = normal_below((half - m.x()) / s.x()) - normal_below((-half - m.x()) / s.x());
    sum += (i == 0 || i == panels ? 1.0 : i % 2 == 1 ? 4.0 : 2.0) * density * across * half;
  }
  return sum * h / 3.0;
}

Limits length_interval(const Eigen::Vector2d& x, const Eigen::Matrix2d& C) {
  constexpr double tail = 0.025;
  const double R = x.norm(), s = std::sqrt(C.trace());
  if (!(R > 0.0) || !(s > 0.0)) return {R, R};
  const auto below = [&](double r) { return probability_within(R, likeliest(r, x, C), C); };
  const double high = crossing(below, tail, R, 0.5 * s);
  return {below(0.0) < 1.0 - tail ? 0.0 : crossing(below, 1.0 - tail, 0.0, R), high};
}

}  // namespace rangecal::diagnosis
