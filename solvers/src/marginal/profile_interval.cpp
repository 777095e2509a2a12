// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/marginal/profile_interval.hpp"

#include <boost/math/tools/toms748_solve.hpp>
#include <cmath>
#include <utility>

#include "marginal/reml_profile.hpp"
#include "rangecal/core/distributions.hpp"

namespace rangecal {
namespace {

/// u on the `side` (-1, +1) of 0 where nu / 2 (e^(-2u) - 1 + 2u) = rise: the end of the interval of a
/// variance with nu degrees of freedom, in the logarithm of its root.
double chi_square_end(double nu, double rise, double side) {
  double u = side * std::sqrt(rise / nu);
  for (int i = 0; i < 30; ++i) {
    const double value = 0.5 * nu * (std::expm1(-2.0 * u) + 2.0 * u) - rise,
                 slope = -nu * std::expm1(-2.0 * u);
    u -= value / slope;
  }
  return u;
}

/// Where `above` (criterion less its bar, negative at 0) turns positive on the side of `guess`; infinity if
/// it stays negative down or up to e^-14, e^14. A solve that fails on the way out is tried again nearer by;
/// none where that fails too.
std::optional<double> crossing(const std::function<double(double)>& above, double at_zero, double guess) {
  double inner = 0.0, outer = guess, inner_value = at_zero;
  for (int failures = 0; failures < 8;) {
    const double value = above(outer);
    if (!std::isfinite(value)) {
      ++failures;
      outer = 0.5 * (inner + outer);
      continue;
    }
    if (value >= 0.0) {
      if (value == 0.0) return outer;
      std::uintmax_t iterations = 20;
      const auto near = [&](double a, double b) { return std::abs(a - b) < 2e-3 * std::abs(guess); };
      const bool up = outer > inner;
      const auto finite = [&](double u) {
        const double height = above(u);
        return std::isfinite(height) ? height : value;
      };
      const auto [a, b] =
          up ? boost::math::tools::toms748_solve(finite, inner, outer, inner_value, value, near, iterations)
             : boost::math::tools::toms748_solve(finite, outer, inner, value, inner_value, near, iterations);
      return 0.5 * (a + b);
    }
    if (std::abs(outer) > 14.0) return std::copysign(std::numeric_limits<double>::infinity(), guess);
    inner = outer;
    inner_value = value;
    outer *= 1.6;
  }
  return std::nullopt;
}

/// What solve_marginal ended with: an estimate of sigma_s at 0 is held there.
struct Converged {
  Converged(const JointProblem& problem, JointState at) : state(std::move(at)) {
    options.estimate_sigma_s =
        problem.estimate_sigma_s && state.sigma_s_m.value_or(0.0) > no_sigma_s(problem);
    if (problem.estimate_sigma_s && !options.estimate_sigma_s) state.sigma_s_m = no_sigma_s(problem);
  }
  JointState state;
  MarginalOptions options;
};

}  // namespace

std::optional<ProfileInterval> profile_interval(const JointProblem& problem, const JointState& state,
                                                Sigma which, double relative_std, double level) {
  if (which == Sigma::noise && !has_sigma(state.noise.law)) return std::nullopt;
  if (which == Sigma::stops && !(problem.estimate_sigma_s && state.sigma_s_m)) return std::nullopt;
  const auto [start, options] = Converged(problem, state);
  RemlProfile below(problem, start, options, which), over(problem, start, options, which);
  const double estimate = which == Sigma::stops   ? *start.sigma_s_m
                          : which == Sigma::theta ? start.sigma_theta_rad
                                                  : start.noise.parameters[0];
  const double rise = 0.5 * chi_squared_quantile(level, 1.0);
  const double bar = below(estimate) + rise;
  if (!std::isfinite(bar)) return std::nullopt;
  const double nu = relative_std > 0.0 && relative_std < 1.0 ? 0.5 / (relative_std * relative_std) : 10.0;
  const auto height = [&](RemlProfile& profile) {
    return [&profile, estimate, bar](double u) { return profile(estimate * std::exp(u)) - bar; };
  };
  ProfileInterval interval;
  const auto high = crossing(height(over), -rise, chi_square_end(nu, rise, 1.0));
  if (!high) return std::nullopt;
  interval.high = estimate * std::exp(*high);
  if (estimate <= no_sigma_s(problem) && which == Sigma::stops) return interval;
  const auto low = crossing(height(below), -rise, chi_square_end(nu, rise, -1.0));
  if (!low) return std::nullopt;
  interval.low = estimate * std::exp(*low);
  return interval;
}

double SigmaSlopes::degrees_of_freedom(const Eigen::VectorXd& contrast) const {
  const double variance = contrast.dot(covariance * contrast);
  Eigen::VectorXd g(static_cast<Eigen::Index>(slopes.size()));
  for (Eigen::Index j = 0; j < g.size(); ++j)
    g[j] = contrast.dot(slopes[static_cast<std::size_t>(j)] * contrast);
  const double spread = g.dot(sigma_covariance * g);
  return spread > 0.0 ? 2.0 * variance * variance / spread : std::numeric_limits<double>::infinity();
}

std::optional<SigmaSlopes> sigma_slopes(const JointProblem& problem, const JointState& state) {
  auto [at, options] = Converged(problem, state);
  Marginal marginal(problem, at, options);
  if (!std::isfinite(marginal.value(at, 1e-9))) return std::nullopt;
  const JointLayout& layout = marginal.layout();
  const auto inverse_of = [](const Eigen::MatrixXd& information) -> std::optional<Eigen::MatrixXd> {
    const Eigen::LLT<Eigen::MatrixXd> factor(information);
    if (factor.info() != Eigen::Success) return std::nullopt;
    return factor.solve(Eigen::MatrixXd::Identity(information.rows(), information.cols()));
  };
  const auto phi_covariance = [&] {
    return inverse_of(marginal.system().schur().topLeftCorner(layout.phi_count, layout.phi_count));
  };
  SigmaSlopes result;
  const auto whole = inverse_of(marginal.hessian(at)), own = phi_covariance();
  if (!whole || !own) return std::nullopt;
  const int sigmas = layout.sigma_count();
  result.covariance = *own;
  result.sigma_covariance = whole->bottomRightCorner(sigmas, sigmas);
  const Eigen::VectorXd still = Eigen::VectorXd::Zero(layout.coordinates);
  for (int j = 0; j < sigmas; ++j) {
    std::optional<Eigen::MatrixXd> moved[2];
    const double step = marginal.step_of(at, j);
    for (int side = 0; side < 2; ++side) {
      Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout.global_count);
      globals[layout.phi_count + j] = side ? step : -step;
      JointState there = step_state(problem, layout, at, globals, still);
      if (std::isfinite(marginal.value(there, 1e-9))) moved[side] = phi_covariance();
      if (!moved[side]) return std::nullopt;
    }
    result.slopes.push_back((*moved[1] - *moved[0]) / (2.0 * step));
  }
  return result;
}

}  // namespace rangecal
