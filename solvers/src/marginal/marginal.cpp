// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/marginal/marginal.hpp"

#include <fmt/core.h>

#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>

#include "marginal/laplace.hpp"
#include "marginal/reml_profile.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

/// Largest sigma_s at which the profile has risen by 1.645^2 / 2: the one-sided 95 % limit.
std::optional<double> upper_limit(RemlProfile& profile, double none) {
  const double rise = 0.5 * z95_one_sided * z95_one_sided, floor = profile(none);
  double low = 10.0 * none, high = 100.0 * none;
  const double highest = 1e7 * none;
  const auto risen = [&](double sigma_s) -> std::optional<bool> {
    const double value = profile(sigma_s);
    return std::isfinite(value) ? std::optional(value - floor >= rise) : std::nullopt;  // no solve, no limit
  };
  std::optional<bool> beyond;
  while (high < highest && (beyond = risen(high)) && !*beyond) {
    low = high;
    high *= 2.0;
  }
  if (high >= highest || !beyond) return std::nullopt;
  for (int step = 0; step < 12; ++step) {
    const double middle = std::sqrt(low * high);
    beyond = risen(middle);
    if (!beyond) return std::nullopt;
    (*beyond ? high : low) = middle;
  }
  return std::sqrt(low * high);
}

/// sigma_s at the minimum of the profile, `none` where it falls to the end. A fixed point in the slopes
/// creeps here: slope and likelihood pull sigma_s against each other, and nearly cancel wherever it is small.
double search_sigma_s(RemlProfile& profile, double none) {
  const auto cost = [&](double log_sigma) {
    const double value = profile(std::exp(log_sigma));
    return std::isfinite(value) ? value : 1e100;
  };
  const auto [log_sigma, value] =
      boost::math::tools::brent_find_minima(cost, std::log(10.0 * none), std::log(1e6 * none), 26);
  return profile(none) <= value + 1e-7 ? none : std::exp(log_sigma);
}

MarginalFit marginal_fit(const JointProblem& problem, const JointState& start, const MarginalOptions& options,
                         const SolverLog& log) {
  MarginalFit fit;
  fit.state = start;
  share_places(problem.stops, fit.state.stops);
  if (options.estimate_sigma_s && !fit.state.sigma_s_m) fit.state.sigma_s_m = 8e-3 * mean_range(problem);
  MarginalOptions without = options;
  without.estimate_sigma_s = false;
  RemlProfile profile(problem, fit.state, without, Sigma::stops);
  Marginal marginal(problem, fit.state, options);
  const double start_value = marginal.value(fit.state);
  fit.start_nll = marginal.joint_nll;
  if (!std::isfinite(start_value)) {
    fit.reason = "the start lies outside the model's domain, or its stops have no optimum";
    return fit;
  }
  if (options.estimate_sigma_s && !options.held.sigmas) {
    const double none = no_sigma_s(problem), sigma_s = search_sigma_s(profile, none), nll = fit.start_nll;
    fit.state = profile.state();
    fit.state.sigma_s_m = sigma_s;
    marginal.value(fit.state);
    if (sigma_s == none) {
      fit = marginal_fit(problem, JointState(fit.state), without, log);
      fit.start_nll = nll;
      fit.sigma_s_upper95_m = upper_limit(profile, none);
      fit.state.sigma_s_m = 0.0;
      return fit;
    }
  }
  const bool converged = marginal.minimise(fit.state, options.held, options.gradient_tolerance,
                                           Marginal::renewal_for(options), log);
  if (!converged) marginal.value(fit.state, 1e-12);
  fit.joint_nll = marginal.joint_nll;
  fit.marginal_nll = marginal.marginal_nll;
  fit.gradient_norm = marginal.gradient_norm;
  fit.iterations = marginal.iterations;
  fit.evaluations = marginal.evaluations;
  fit.outcome = converged ? Outcome::converged : Outcome::not_converged;
  if (converged) fit.reml = marginal.reml();
  for (int i : converged ? marginal.vanished() : std::vector<int>{})
    fit.reason +=
        fmt::format("{}{} is drawn to 0 and held: the errors of the stops explain all that it would",
                    fit.reason.empty() ? "" : "; ",
                    i == marginal.layout().sigma_theta ? "sigma_theta"
                    : i == marginal.layout().sigma_s   ? "sigma_s"
                                                       : "sigma_e");
  if (!converged)
    fit.reason = fmt::format("no fixed point after {} iterations; gradient norm {:.1e}", fit.iterations,
                             fit.gradient_norm);
  describe_covariance(marginal.hessian(fit.state), marginal.layout(), marginal.free_of(options.held), fit);
  return fit;
}

}  // namespace

MarginalFit solve_marginal(const JointProblem& problem, const JointState& start,
                           const MarginalOptions& options) {
  return followed("marginal", start.alpha.size(), start.noise.law, &MarginalFit::marginal_nll,
                  [&](const SolverLog& log) { return marginal_fit(problem, start, options, log); });
}

}  // namespace rangecal
