// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/smoothing_spline.hpp"

#include <Eigen/Cholesky>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>
#include <vector>

#include "rangecal/core/symmetric_eigen.hpp"

namespace rangecal {
namespace {

constexpr std::size_t fewest_distances = 5, most_knots = 40;

/// How far along a curve distances are, from 0 to 1: half of it by their number, half by what readings change, so that a curve has as
/// many knots where it is steep as where it is long. Readings count by means of neighbours.
std::vector<double> shares_along(const std::vector<double>& distinct, std::span<const double> true_m,
                                 std::span<const double> reading_m) {
  const std::size_t groups = std::min(distinct.size(), most_knots);
  const auto group_of = [&](std::size_t place) { return place * groups / distinct.size(); };
  std::vector<double> sum(groups, 0.0), count(groups, 0.0);
  for (std::size_t i = 0; i < true_m.size(); ++i) {
    const auto place = static_cast<std::size_t>(
        std::upper_bound(distinct.begin(), distinct.end(), true_m[i]) - distinct.begin() - 1);
    sum[group_of(place)] += reading_m[i];
    count[group_of(place)] += 1.0;
  }
  std::vector<double> change(groups, 0.0);  // from the first group on
  for (std::size_t g = 1; g < groups; ++g)
    change[g] = change[g - 1] + std::abs(sum[g] / count[g] - sum[g - 1] / count[g - 1]);
  std::vector<double> shares;
  for (std::size_t k = 0; k < distinct.size(); ++k) {
    const double number = static_cast<double>(k) / static_cast<double>(distinct.size() - 1);
    const double at = number * static_cast<double>(groups - 1);
    const auto g = std::min(static_cast<std::size_t>(at), groups - 2);
    const double along = change[g] + (at - static_cast<double>(g)) * (change[g + 1] - change[g]);
    shares.push_back(change.back() > 0.0 ? 0.5 * (number + along / change.back()) : number);
  }
  return shares;
}

/// Different distances at equal shares along the curve, the outer ones among them; of such as are nearly equal one.
Eigen::VectorXd knots_of(std::span<const double> true_m, std::span<const double> reading_m) {
  std::vector<double> distinct(true_m.begin(), true_m.end());
  std::sort(distinct.begin(), distinct.end());
  const double nearly = distinct.empty() ? 0.0 : 1e-4 * (distinct.back() - distinct.front());
  distinct.erase(std::unique(distinct.begin(), distinct.end(),
                             [&](double kept, double next) { return next - kept <= nearly; }),
                 distinct.end());
  if (distinct.size() > most_knots) {
    const std::vector<double> shares = shares_along(distinct, true_m, reading_m);
    std::vector<double> chosen;
    for (std::size_t k = 0; k < distinct.size(); ++k)
      if (chosen.empty() || k + 1 == distinct.size() ||
          shares[k] * (most_knots - 1) >= static_cast<double>(chosen.size()))
        chosen.push_back(distinct[k]);
    distinct = std::move(chosen);
  }
  return Eigen::VectorXd::Map(distinct.data(), static_cast<Eigen::Index>(distinct.size()));
}

/// The penalised least squares of the readings in the coordinates in which both the readings' information and the penalty are diagonal
/// (Demmler and Reinsch 1975): values g = T beta + B gamma, T of straight lines, B of NaturalSpline::bends.
class PenalisedSquares {
 public:
  PenalisedSquares(const Eigen::VectorXd& knots, std::span<const double> true_m,
                   std::span<const double> reading_m, std::span<const double> weights)
      : knots_(knots), readings_(static_cast<double>(true_m.size())) {
    const NaturalSpline any(knots, Eigen::VectorXd::Zero(knots.size()));
    A_.setZero(knots.size(), knots.size());
    Eigen::VectorXd b = Eigen::VectorXd::Zero(knots.size());
    double square = 0.0;
    level_ = std::accumulate(reading_m.begin(), reading_m.end(), 0.0) / readings_;  // apart, for its digits
    for (std::size_t i = 0; i < true_m.size(); ++i) {
      const Eigen::VectorXd N = any.weights(true_m[i]);
      const double w = weights.empty() ? 1.0 : weights[i], y = reading_m[i] - level_;
      A_ += w * N * N.transpose();
      b += w * y * N;
      square += w * y * y;
    }
    Eigen::MatrixXd T(knots.size(), 2);
    T << Eigen::VectorXd::Ones(knots.size()), (knots.array() - knots.mean()).matrix();
    const Eigen::LLT<Eigen::Matrix2d> of_lines(T.transpose() * A_ * T);
    lines_ = of_lines.matrixU().solve<Eigen::OnTheRight>(T);  // T U^-1, with U^T U = T^T A T
    line_ = lines_ * (lines_.transpose() * b);
    const Eigen::MatrixXd bends = any.bends();
    const Eigen::MatrixXd beside =
        bends - lines_ * (lines_.transpose() * (A_ * bends));  // the lines at their best
    const SymmetricEigen eigen = symmetric_eigen(beside.transpose() * A_ * beside);
    information_ = eigen.values.cwiseMax(0.0);
    bends_ = beside * eigen.vectors;
    pull_ = bends_.transpose() * b;
    // What is left is rounding of the readings' squares at the least.
    left_by_lines_ = std::max(square - b.dot(line_), 1e-15 * square);
    least_left_ = 1e-15 * square;
  }

  /// ln of the lambdas between which the curve goes from all that the readings ask for to a straight line.
  double least_rigid() const { return std::log(largest() * 1e-12); }
  double most_rigid() const { return std::log(largest() * 1e6); }

  struct Fit {
    Eigen::VectorXd values;
    Eigen::MatrixXd root;  ///< of their covariance, R R^T
    double degrees = 0.0, minus_twice_restricted = 0.0;
  };
  Fit at(double log_lambda) const {
    const double lambda = std::exp(log_lambda);
    const Eigen::ArrayXd total = information_.array() + lambda;
    const double sigma_sq =
        std::max(left_by_lines_ - (pull_.array().square() / total).sum(), least_left_) / (readings_ - 2.0);
    Fit fit;
    fit.values = (line_ + bends_ * (pull_.array() / total).matrix()).array() + level_;
    fit.root.resize(knots_.size(), 2 + bends_.cols());
    fit.root << lines_, bends_ * total.rsqrt().matrix().asDiagonal();
    fit.root *= std::sqrt(sigma_sq);
    fit.degrees = 2.0 + (information_.array() / total).sum();
    fit.minus_twice_restricted = (readings_ - 2.0) * std::log(sigma_sq) + (total / lambda).log().sum();
    return fit;
  }

  /// ln of the likeliest lambda.
  double likeliest() const {
    constexpr double step = 0.7;
    double best = least_rigid(), least = std::numeric_limits<double>::infinity();
    for (double t = least_rigid(); t <= most_rigid(); t += step)
      if (const double value = at(t).minus_twice_restricted; value < least) {
        least = value;
        best = t;
      }
    const auto criterion = [&](double t) { return at(t).minus_twice_restricted; };
    return boost::math::tools::brent_find_minima(criterion, best - step, best + step, 26).first;
  }

  /// The covariance of the values at the knots but for what changes of level and of the curve's own scale make of them.
  Eigen::MatrixXd beside_line(const Fit& fit) const {
    Eigen::MatrixXd line(knots_.size(), 2);
    line << Eigen::VectorXd::Ones(knots_.size()), (fit.values.array() - level_).matrix();
    const Eigen::MatrixXd taken = (line.transpose() * A_ * line).ldlt().solve(line.transpose() * A_);
    const Eigen::MatrixXd left = fit.root - line * (taken * fit.root);
    Eigen::MatrixXd C = Eigen::MatrixXd::Zero(knots_.size(), knots_.size());
    C.selfadjointView<Eigen::Lower>().rankUpdate(left);
    return C.selfadjointView<Eigen::Lower>();
  }

 private:
  double largest() const { return std::max(information_.maxCoeff(), std::numeric_limits<double>::min()); }

  const Eigen::VectorXd& knots_;
  double readings_, level_ = 0.0, left_by_lines_ = 0.0, least_left_ = 0.0;
  Eigen::MatrixXd A_;      ///< information of the values at the knots
  Eigen::MatrixXd lines_;  ///< root of the covariance of the line that fits best, in units of sigma
  Eigen::VectorXd line_;   ///< its values, less the level
  Eigen::MatrixXd bends_;  ///< values of the other coordinates, by column
  Eigen::VectorXd information_, pull_;  ///< of these coordinates
};

double mean_slope_of(const Eigen::VectorXd& knots, const Eigen::VectorXd& values) {
  return (values.tail(1)[0] - values[0]) / (knots.tail(1)[0] - knots[0]);
}

/// The curve through these values as a scale: 0 at the distance 0, of mean slope 1. None where it does not rise (or fall) everywhere,
/// with a thousandth of that at the least.
std::optional<NaturalSpline> rising(const Eigen::VectorXd& knots, const Eigen::VectorXd& values) {
  constexpr double least_slope = 1e-3;
  const double factor = mean_slope_of(knots, values);
  if (!(std::abs(factor) * (knots.tail(1)[0] - knots[0]) > 1e-12 * values.cwiseAbs().maxCoeff()))
    return std::nullopt;
  const Eigen::VectorXd above = (values.array() - values[0]) / factor;
  const double first = knots[0] * NaturalSpline(knots, above).slope(knots[0]);
  NaturalSpline u(knots, above.array() + first);
  if (!(u.least_slope() > least_slope)) return std::nullopt;
  return u;
}

}  // namespace

std::optional<SmoothingSpline> smoothing_spline(std::span<const double> true_m,
                                                std::span<const double> reading_m,
                                                std::span<const double> weights) {
  const Eigen::VectorXd knots = knots_of(true_m, reading_m);
  if (knots.size() < static_cast<Eigen::Index>(fewest_distances) || true_m.size() < fewest_distances + 1)
    return std::nullopt;
  if (!weights.empty()) {
    constexpr double most = 1e10;  // beyond that a sum of weights knows the heaviest alone
    const auto [least, largest] = std::minmax_element(weights.begin(), weights.end());
    if (!(*least > 0.0) || !(*largest < most * *least)) return std::nullopt;
  }
  const PenalisedSquares squares(knots, true_m, reading_m, weights);
  double t = squares.likeliest();
  const auto rises_at = [&](double at) { return rising(knots, squares.at(at).values).has_value(); };
  SmoothingSpline found;
  found.stiffened = !rises_at(t);
  if (found.stiffened) {
    double turns = t, rises = squares.most_rigid();
    if (!rises_at(rises)) return std::nullopt;
    while (rises - turns > 1e-3) (rises_at(0.5 * (turns + rises)) ? rises : turns) = 0.5 * (turns + rises);
    t = rises;
  }
  const PenalisedSquares::Fit fit = squares.at(t);
  CurveScale& scale = found.scale;
  scale.family = CurveFamily::spline;
  scale.spline.emplace();
  scale.spline->u = *rising(knots, fit.values);
  found.factor = mean_slope_of(knots, fit.values);
  found.level = fit.values[0] - found.factor * scale.spline->u.values()[0];
  scale.spline->covariance = squares.beside_line(fit) / (found.factor * found.factor);
  scale.spline->degrees = std::max(2.0, fit.degrees);
  return found;
}

}  // namespace rangecal
