// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/curve.hpp"

#include <fmt/core.h>

#include <array>
#include <cmath>
#include <limits>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal {
namespace {

Eigen::MatrixXd padded(const std::optional<Eigen::MatrixXd>& covariance, Eigen::Index size) {
  Eigen::MatrixXd whole = Eigen::MatrixXd::Zero(size, size);
  if (covariance) whole.topLeftCorner(covariance->rows(), covariance->cols()) = *covariance;
  return whole;
}

/// Why curves of different orders cannot be judged; empty where they can.
std::string order_in_the_way(const Calibration& before, const Calibration& after) {
  if (before.order() == after.order()) return {};
  const std::string orders =
      fmt::format("the orders differ ({} and {}), and the calibration", before.order(), after.order());
  const int highest = std::max(before.order(), after.order());
  for (const Calibration* c : {&before, &after}) {
    if (!curve_covariance(*c)) continue;
    const char* which = c == &before ? "before" : "now";
    if (!c->covariance_with_choice)
      return fmt::format(
          "{} {} states its uncertainty for its own order alone; calibrate both with one --order, or let both choose it",
          orders, which);
    if (const auto reach = static_cast<int>(c->covariance_with_choice->rows()) - 1; reach < highest)
      return fmt::format("{} {} says nothing of orders above {}", orders, which, reach);
  }
  return {};
}

/// nu_i of the header; infinity where the calibration does not tell.
double noise_degrees(const Calibration& c) {
  double degrees = std::numeric_limits<double>::infinity();
  const auto told = [&](const Estimate& sigma) {
    if (sigma.std_dev && *sigma.std_dev > 0.0 && std::isfinite(sigma.value))
      degrees = std::min(degrees, 0.5 * std::pow(sigma.value / *sigma.std_dev, 2));
  };
  if (has_sigma(c.noise.law) && c.noise_estimates.size() == 1) told(c.noise_estimates[0]);
  if (c.sigma_theta_rad) told(*c.sigma_theta_rad);
  if (c.counts.used > 0)
    degrees = std::min(degrees, static_cast<double>(c.counts.used) - static_cast<double>(c.alpha.size()));
  if (c.sigma_s_m && !c.stops.empty()) degrees = std::min(degrees, 2.0 * static_cast<double>(c.stops.size()));
  return std::max(degrees, 0.0);
}

/// One calibration's part of C, and how well the noise behind it is known.
struct CovariancePart {
  Eigen::MatrixXd covariance;
  double degrees = std::numeric_limits<double>::infinity();
};

struct SquaredDistance {
  double square = 0.0;   ///< T^2
  int rank = 0;          ///< r
  double degrees = 0.0;  ///< nu
};

/// T^2 after scaling C to a unit diagonal, and nu of the header.
SquaredDistance squared_distance(const Eigen::VectorXd& delta, const std::array<CovariancePart, 2>& parts) {
  const Eigen::MatrixXd C = parts[0].covariance + parts[1].covariance;
  Eigen::VectorXd scale = C.diagonal().cwiseMax(0.0).cwiseSqrt();
  for (double& s : scale) s = s > 0.0 ? 1.0 / s : 0.0;
  const SymmetricEigen eigen = symmetric_eigen(scale.asDiagonal() * C * scale.asDiagonal());
  SquaredDistance result;
  Eigen::MatrixXd whitening(delta.size(), delta.size());  // its first r columns: W^T C W = 1
  for (Eigen::Index i = 0; i < delta.size(); ++i)
    if (eigen.values[i] > 1e-12)
      whitening.col(result.rank++) = scale.cwiseProduct(eigen.vectors.col(i)) / std::sqrt(eigen.values[i]);
  const Eigen::MatrixXd W = whitening.leftCols(result.rank);
  result.square = (W.transpose() * delta).squaredNorm();
  double loss = 0.0;
  for (const CovariancePart& part : parts) {
    const Eigen::MatrixXd share = W.transpose() * part.covariance * W;
    const double squares = share.squaredNorm() + std::pow(share.trace(), 2);
    if (squares > 0.0) loss += squares / part.degrees;
  }
  result.degrees = result.rank * (result.rank + 1.0) / loss;
  return result;
}

/// Fills in T^2 and its p-value, or why there is none.
void refer_to_law(const SquaredDistance& distance, CurveChange& change) {
  change.degrees_of_freedom = distance.rank;
  const double r = distance.rank, below = distance.degrees - r + 1.0;
  if (distance.rank == 0) {
    change.reason = "the covariance is zero";
    return;
  }
  if (!(below > 0.0)) {
    change.reason =
        fmt::format("the noise is known with {:.1f} degrees of freedom, too few to judge {} coefficients",
                    distance.degrees, distance.rank);
    return;
  }
  change.chi_sq = distance.square;
  if (std::isfinite(below)) change.noise_degrees_of_freedom = below;
  if (!std::isfinite(distance.square))
    change.p_value = 0.0;
  else if (change.noise_degrees_of_freedom)
    change.p_value = fisher_f_upper(distance.square * below / (distance.degrees * r), r, below);
  else
    change.p_value = chi_squared_upper(distance.square, r);
}

}  // namespace

std::optional<CurvePoint> curve_point(const Calibration& calibration, double distance_m) {
  if (calibration.alpha.size() == 0 || !calibration.alpha.allFinite()) return std::nullopt;
  CurvePoint point;
  point.distance_m = distance_m;
  point.reading_m = calibration.f(distance_m);
  const double u = calibration.scale.of(distance_m);
  point.noise_m = calibration.noise.spread(distance_m, point.reading_m);
  const double of_shape = shape_variance(calibration, distance_m);
  if (calibration.alpha_covariance)
    point.std_dev_m = std::sqrt(evaluate_form(*calibration.alpha_covariance, u) + of_shape);
  if (calibration.covariance_with_choice)
    point.std_dev_with_choice_m = std::sqrt(evaluate_form(*calibration.covariance_with_choice, u) + of_shape);
  return point;
}

std::vector<CurvePoint> curve_points(const Calibration& calibration, int count) {
  std::vector<CurvePoint> points;
  const double low = calibration.range_min_m, high = calibration.range_max_m;
  for (int i = 0; i < count; ++i)
    if (const auto point = curve_point(calibration, low + (high - low) * i / std::max(1, count - 1)))
      points.push_back(*point);
  return points;
}

CurveChange compare_curves(const Calibration& before, const Calibration& after) {
  if (before.alpha.size() == 0 || !before.alpha.allFinite())
    throw InputError("the calibration before has no curve f");
  if (after.alpha.size() == 0 || !after.alpha.allFinite())
    throw InputError("the calibration after has no curve f");
  const double low = after.range_min_m, high = after.range_max_m;
  if (!(low >= 0.0) || !(high > low)) throw InputError("the range fitted by the calibration after is empty");

  Eigen::Index size = std::max(before.alpha.size(), after.alpha.size());
  for (const Calibration* c : {&before, &after})
    if (curve_covariance(*c)) size = std::max(size, curve_covariance(*c)->rows());
  Eigen::VectorXd delta = Eigen::VectorXd::Zero(size);
  delta.head(after.alpha.size()) += after.alpha;
  delta.head(before.alpha.size()) -= before.alpha;
  CurveChange change;
  std::array<CovariancePart, 2> parts;
  const bool known = curve_covariance(after).has_value();
  if (known) {
    change.first_taken_as_exact = !curve_covariance(before);
    change.given_the_model =
        !after.covariance_with_choice || (!change.first_taken_as_exact && !before.covariance_with_choice);
    parts[0].covariance = padded(curve_covariance(before), size);
    if (!change.first_taken_as_exact) parts[0].degrees = noise_degrees(before);
    parts[1] = {padded(curve_covariance(after), size), noise_degrees(after)};
  }
  constexpr int grid = 200;
  for (int i = 0; i <= grid; ++i) {
    const double d = low + (high - low) * i / grid, moved = after.f(d) - before.f(d);
    change.largest_m = std::max(change.largest_m, std::abs(moved));
    change.rms_m += moved * moved / (grid + 1);
  }
  change.rms_m = std::sqrt(change.rms_m);
  for (int i = 0; i < 5; ++i) {
    const double d = low + (high - low) * i / 4.0;
    CurveChange::At at{d, after.f(d) - before.f(d), std::nullopt};
    if (known)
      at.std_dev_m =
          std::sqrt(curve_variance(before, d).value_or(0.0) + curve_variance(after, d).value_or(0.0));
    change.at.push_back(at);
  }
  if (!known)
    change.reason = "the new calibration has no covariance";
  else if (!before.scale.same_as(after.scale))
    change.reason =
        "the curves are polynomials in different scales, which no test of their coefficients compares";
  else
    change.reason = order_in_the_way(before, after);
  if (change.reason.empty()) refer_to_law(squared_distance(delta, parts), change);
  return change;
}

}  // namespace rangecal
