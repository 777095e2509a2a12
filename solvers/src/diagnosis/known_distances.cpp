// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/known_distances.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numeric>
#include <utility>

#include "joint_ml/newton_step.hpp"
#include "pairs_ml/pairs_reml.hpp"
#include "rangecal/core/quantiles.hpp"
#include "solver_log.hpp"

namespace rangecal::diagnosis {
namespace {

/// The cells as the 2016 problem, whose first is the nearest and whose last the farthest: the two set its scale.
PairsProblem pairs_of(const JointProblem& problem, const JointState& state) {
  const Cells& c = problem.cells;
  const std::size_t size = c.size();
  PairsProblem pairs;
  pairs.true_m.resize(size);
  for (std::size_t i = 0; i < size; ++i)
    pairs.true_m[i] =
        state.landmarks[static_cast<std::size_t>(c.landmark[i])].x() - problem.stops[c.stop[i]].commanded.x_m;
  pairs.count = c.count;
  pairs.weight = c.range_weight;
  pairs.mean_m = c.range_mean;
  pairs.mean_square = c.range_mean_square;
  pairs.single = false;
  pairs.row_true_m.resize(static_cast<std::size_t>(problem.readings));  // their number alone is asked for
  const auto exchange = [&](std::size_t i, std::size_t j) {
    for (auto* column : {&pairs.true_m, &pairs.count, &pairs.weight, &pairs.mean_m, &pairs.mean_square})
      std::swap((*column)[i], (*column)[j]);
  };
  const auto index = [&](auto found) { return static_cast<std::size_t>(found - pairs.true_m.begin()); };
  exchange(0, index(std::min_element(pairs.true_m.begin(), pairs.true_m.end())));
  exchange(size - 1, index(std::max_element(pairs.true_m.begin(), pairs.true_m.end())));
  return pairs;
}

/// Second derivatives of the likelihood in the globals of the joint problem: alpha and log sigma; the landmark's
/// are left at zero, the bearings know sigma_theta alone.
Eigen::MatrixXd hessian_in_globals(const pairs_ml::ScaledPairs& scaled, const pairs_ml::NewtonResult& at,
                                   const JointLayout& layout, double readings) {
  Eigen::MatrixXd jacobian = scaled.jacobian(at.x);
  jacobian(jacobian.rows() - 1, jacobian.cols() - 1) = 1.0;  // log sigma is a global itself
  const Eigen::MatrixXd inverse = jacobian.inverse();
  const Eigen::MatrixXd own = inverse.transpose() * at.at.hessian * inverse;
  std::vector<int> places(static_cast<std::size_t>(own.rows()));
  std::iota(places.begin(), places.begin() + layout.alpha_count, 0);
  std::iota(places.begin() + layout.alpha_count, places.end(), layout.tau_begin);
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(layout.global_count, layout.global_count);
  hessian(places, places) = own;
  hessian(layout.sigma_theta, layout.sigma_theta) = 2.0 * readings;
  return hessian;
}

/// log sigma to where the residuals of the start put it: from far below Newton's steps of curve and sigma go astray.
void settle_sigma(const pairs_ml::ScaledPairs& scaled, pairs_ml::Vector& x) {
  pairs_ml::Evaluation at;
  scaled.evaluate(x, false, at);
  if (!at.valid) return;
  const Eigen::Index last = x.size() - 1;
  const double squares = 0.5 * at.hessian(last, last), readings = at.gradient[last] + squares;
  if (squares > 0.0 && readings > 0.0) x[last] += 0.5 * std::log(squares / readings);
}

/// The layout of the globals does not depend on the stops: that of one of them.
JointProblem of_one_stop(const JointProblem& problem) {
  JointProblem one;
  one.landmark_radius_m = problem.landmark_radius_m;
  one.landmark_recording = problem.landmark_recording;
  one.stops = {problem.stops.front()};
  one.stops.front().place = 0;
  one.place_count = 1;
  one.sigma_s_shared = {0};
  one.cells.stop_begin = {0, 0};
  return one;
}

}  // namespace

std::optional<MarginalFit> solve_at_known_distances(const JointProblem& problem, const JointState& start) {
  constexpr int max_iterations = 60;
  constexpr double full_tolerance = 1e-3;  // REML starts there
  SolverLog log("known distances");
  if (log.on()) log.of(curve_in_words(start.alpha.size(), start.noise.law));
  const int order = static_cast<int>(start.alpha.size()) - 1;
  if (!has_sigma(start.noise.law) || order + 2 > pairs_ml::max_unknowns || problem.cells.size() == 0)
    return std::nullopt;
  const PairsProblem pairs = pairs_of(problem, start);
  const pairs_ml::ScaledPairs scaled(pairs, order, start.noise.law, 0, std::numeric_limits<int>::max());
  pairs_ml::Vector x = scaled.from_user(start.alpha, start.noise);
  if (!x.allFinite()) return std::nullopt;
  settle_sigma(scaled, x);
  pairs_ml::NewtonResult full =
      pairs_ml::minimise(scaled, x, scaled.unknowns(), max_iterations, full_tolerance);
  if (full.outcome != Outcome::converged) full.x = x;
  const pairs_ml::NewtonResult found = pairs_ml::restricted(scaled, full, max_iterations);
  log.end(found.iterations, found.at.nll, not_known, found.outcome);
  if (found.outcome != Outcome::converged) return std::nullopt;
  MarginalFit fit;
  fit.state = start;
  fit.state.alpha = scaled.alpha(found.x);
  fit.state.noise = scaled.noise(found.x);
  fit.state.sigma_theta_rad = 1.0;
  for (std::size_t k = 0; k < problem.stops.size(); ++k) fit.state.stops[k] = problem.stops[k].commanded;
  fit.iterations = found.iterations;
  fit.outcome = Outcome::converged;
  // The bearings, all alike, at sigma_theta = 1 rad.
  fit.joint_nll = fit.marginal_nll = found.at.nll + SilentBearing::nll(problem.readings);
  const JointProblem one = of_one_stop(problem);
  const JointLayout layout(one, order + 1, 1, false);
  Held held;
  held.landmarks = true;
  describe_covariance(hessian_in_globals(scaled, found, layout, problem.readings), layout,
                      free_globals(layout, held), fit);
  return fit;
}

namespace {

/// Readings in a sequence under a curve whose coefficients are scaled: x_j = alpha_j scale^j belongs to (u / scale)^j. What is
/// summed over the readings does not depend on tau; the rest is a matter of e^(-2 tau).
class SerialProblem {
 public:
  struct Point {
    Eigen::VectorXd x;
    bool inside = false;       ///< of the domain
    double log_spreads = 0.0;  ///< sum g
    double squares = 0.0;      ///< u^T u and the mean squares that tails add, in units of e^(-2 tau)
    Eigen::VectorXd of_spreads, of_squares;                ///< their slopes in x, half those of the squares
    Eigen::MatrixXd mean_information, spread_information;  ///< in x, of the means in units of e^(-2 tau)
  };

  SerialProblem(const JointProblem& problem, const SerialErrors& serial, const JointState& start)
      : cells_(problem.cells),
        serial_(serial),
        power_of_f_(start.noise.power_of_f()),
        power_of_d_(form_of(start.noise.law).power_of_d),
        n_(static_cast<Eigen::Index>(cells_.size())) {
    u_.resize(n_);
    for (Eigen::Index i = 0; i < n_; ++i)
      u_[i] = start.landmarks[static_cast<std::size_t>(cells_.landmark[i])].x() -
              problem.stops[static_cast<std::size_t>(cells_.stop[i])].commanded.x_m;
    const double scale = std::max(u_.cwiseAbs().maxCoeff(), 1e-300);
    powers_.resize(n_, start.alpha.size());
    powers_.col(0).setOnes();
    scales_ = Eigen::VectorXd::Ones(powers_.cols());
    for (Eigen::Index j = 1; j < powers_.cols(); ++j) {
      powers_.col(j) = powers_.col(j - 1).cwiseProduct(u_ / scale);
      scales_[j] = scales_[j - 1] * scale;
    }
  }

  Eigen::VectorXd x_of(const Eigen::VectorXd& alpha) const { return alpha.cwiseProduct(scales_); }
  Eigen::VectorXd alpha_of(const Eigen::VectorXd& x) const { return x.cwiseQuotient(scales_); }
  const Eigen::VectorXd& scales() const { return scales_; }
  double count() const { return static_cast<double>(n_); }

  Point at(const Eigen::VectorXd& x) const {
    Point point;
    point.x = x;
    const double p = power_of_f_;
    const Eigen::ArrayXd f = (powers_ * x).array();
    if (power_of_f_ > 0 && !(f.minCoeff() > 0.0)) return point;
    const Eigen::Map<const Eigen::ArrayXd> weight(cells_.range_weight.data(), n_),
        mean(cells_.range_mean.data(), n_), mean_square(cells_.range_mean_square.data(), n_);
    Eigen::ArrayXd root = weight.sqrt();  // sqrt(W) / s in units of e^-tau
    for (int i = 0; i < power_of_f_; ++i) root /= f;
    for (int i = 0; i < power_of_d_; ++i) root /= u_.array();
    if (power_of_f_ > 0) point.log_spreads += p * f.log().sum();
    if (power_of_d_ > 0) point.log_spreads += power_of_d_ * u_.array().log().sum();
    const Eigen::ArrayXd extra = root.square() * mean_square;
    Eigen::ArrayXd z = root * (mean - f);
    for (Eigen::Index i = 0; !cells_.effect_slope.empty() && i < n_; ++i)
      z[i] -= root[i] * cells_.effect_change(static_cast<std::size_t>(i), u_[i]);
    SerialErrors::Columns columns(n_, powers_.cols() + 1);  // of the coefficients, and the residuals
    columns.leftCols(powers_.cols()) = root.matrix().asDiagonal() * powers_;
    columns.rightCols(1) = z.matrix();
    columns = serial_.whitened_columns(std::move(columns));
    const Eigen::VectorXd white = columns.rightCols(1);
    point.squares = white.squaredNorm() + extra.sum();
    point.inside = std::isfinite(point.log_spreads) && std::isfinite(point.squares);
    // dz/df = -root - p z / f, dg/df = p / f
    const Eigen::VectorXd pull = serial_.transposed(white);
    const Eigen::ArrayXd relative = p / f;
    point.of_spreads = powers_.transpose() * relative.matrix();
    point.of_squares =
        -(powers_.transpose() * (pull.array() * (root + relative * z) + relative * extra).matrix());
    const auto of_means = columns.leftCols(powers_.cols());
    point.mean_information = of_means.transpose() * of_means;
    const Eigen::MatrixXd by_spread = relative.matrix().asDiagonal() * powers_;
    point.spread_information = 2.0 * by_spread.transpose() * by_spread;
    return point;
  }

  double nll(const Point& at, double tau) const {
    if (!at.inside) return std::numeric_limits<double>::infinity();
    return count() * (tau + half_log_two_pi) + at.log_spreads + 0.5 * std::exp(-2.0 * tau) * at.squares;
  }
  Eigen::VectorXd gradient(const Point& at, double tau) const {
    return at.of_spreads + std::exp(-2.0 * tau) * at.of_squares;
  }
  Eigen::MatrixXd information(const Point& at, double tau) const {
    return std::exp(-2.0 * tau) * at.mean_information + at.spread_information;
  }

  /// The REML estimate of tau at the point: squares e^(-2 tau) = n - tr(information^-1 of the means'); that of ML where alpha
  /// is not estimated.
  double settled_tau(const Point& at, double tau, bool reml) const {
    for (int round = 0; round < 3; ++round) {
      double lost = 0.0;
      if (reml) {
        const Eigen::MatrixXd of_means = std::exp(-2.0 * tau) * at.mean_information;
        lost = (of_means + at.spread_information).ldlt().solve(of_means).trace();
      }
      tau = 0.5 * std::log(std::max(at.squares, 1e-300) / std::max(1.0, count() - lost));
    }
    return tau;
  }

 private:
  const Cells& cells_;
  const SerialErrors& serial_;
  int power_of_f_, power_of_d_;
  Eigen::Index n_;
  Eigen::VectorXd u_, scales_;  ///< u of the known distances
  Eigen::MatrixXd powers_;
};

}  // namespace

MarginalFit solve_with_serial_errors(const JointProblem& problem, const SerialErrors& serial,
                                     const JointState& start, const Held& held) {
  constexpr int most_steps = 60, most_halvings = 30;
  constexpr double settled = 1e-7;  // nats
  SolverLog log("serial errors");
  if (log.on()) log.of(curve_in_words(start.alpha.size(), start.noise.law));
  MarginalFit fit;
  fit.state = start;
  if (!has_sigma(start.noise.law) || problem.cells.size() == 0) {
    fit.reason = "the noise law is no power of the curve";
    return fit;
  }
  const SerialProblem pairs(problem, serial, start);
  SerialProblem::Point here = pairs.at(pairs.x_of(start.alpha));
  double tau = std::log(start.noise.parameters[0]);
  if (!here.inside) {
    fit.reason = "the start is outside of the model's domain";
    return fit;
  }
  fit.outcome = Outcome::not_converged;
  while (fit.iterations < most_steps && fit.outcome != Outcome::converged) {
    ++fit.iterations;
    if (!held.sigmas) tau = pairs.settled_tau(here, tau, !held.alpha);
    if (held.alpha) {
      fit.outcome = Outcome::converged;
      break;
    }
    const Eigen::VectorXd gradient = pairs.gradient(here, tau);
    const Eigen::VectorXd step = -pairs.information(here, tau).ldlt().solve(gradient);
    if (!step.allFinite()) break;
    if (-0.5 * gradient.dot(step) < settled) {
      fit.outcome = Outcome::converged;
      break;
    }
    const double value = pairs.nll(here, tau);
    double length = 1.0;
    SerialProblem::Point next = pairs.at(here.x + step);
    for (int halving = 0; halving < most_halvings && !(pairs.nll(next, tau) <= value); ++halving)
      next = pairs.at(here.x + (length *= 0.5) * step);
    const double norm = std::sqrt(-gradient.dot(step)), reached = pairs.nll(next, tau);
    log.iteration(fit.iterations, std::fmin(reached, value), reached <= value ? length * norm : 0.0, norm,
                  {"length", length});
    if (!(reached <= value)) break;
    here = std::move(next);
  }
  fit.state.alpha = pairs.alpha_of(here.x);
  fit.state.noise.parameters[0] = std::exp(tau);
  fit.state.sigma_theta_rad = 1.0;
  for (std::size_t k = 0; k < problem.stops.size(); ++k) fit.state.stops[k] = problem.stops[k].commanded;
  fit.joint_nll = fit.marginal_nll = pairs.nll(here, tau) + SilentBearing::nll(problem.readings);
  const JointProblem one = of_one_stop(problem);
  const auto alphas = static_cast<int>(start.alpha.size());
  const JointLayout layout(one, alphas, 1, false);
  Eigen::MatrixXd hessian = Eigen::MatrixXd::Zero(layout.global_count, layout.global_count);
  const Eigen::MatrixXd scale = pairs.scales().asDiagonal();
  hessian.topLeftCorner(alphas, alphas) = scale * pairs.information(here, tau) * scale;
  const Eigen::VectorXd in_alpha_and_tau = 2.0 * (scale * here.of_spreads);
  hessian.block(0, layout.tau_begin, alphas, 1) = in_alpha_and_tau;
  hessian.block(layout.tau_begin, 0, 1, alphas) = in_alpha_and_tau.transpose();
  hessian(layout.tau_begin, layout.tau_begin) = 2.0 * problem.readings;
  hessian(layout.sigma_theta, layout.sigma_theta) = 2.0 * problem.readings;
  Held given = held;
  given.landmarks = true;
  describe_covariance(hessian, layout, free_globals(layout, given), fit);
  log.end(fit.iterations, fit.marginal_nll, not_known, fit.outcome, fit.reason);
  return fit;
}

}  // namespace rangecal::diagnosis
