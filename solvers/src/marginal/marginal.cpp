// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/marginal/marginal.hpp"

#include <fmt/core.h>

#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <limits>

#include "marginal/laplace.hpp"
#include "marginal/marginal_likelihood.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The REML criterion l_s + 1/2 log det A, minimised over all but sigma_s, as a function of sigma_s [m].
/// `options` without a free sigma_s. Starts where the last value ended; +infinity where there is no optimum.
class SigmaSProfile {
 public:
  SigmaSProfile(const JointProblem& problem, JointState state, const MarginalOptions& options)
      : problem_(problem), state_(std::move(state)), options_(options) {}

  double operator()(double sigma_s) {
    JointState at = state_;
    at.sigma_s_m = sigma_s;
    Marginal marginal(problem_, at, options_);
    const Held& held = options_.held;
    if (!std::isfinite(marginal.value(at)) || !marginal.minimise(at, held, 1e-5, Marginal::Renewal{})) return infinity;
    const double value = marginal.marginal_nll + marginal.half_log_det_phi(held);
    if (std::isfinite(value)) state_ = at;
    return value;
  }
  const JointState& state() const { return state_; }

 private:
  const JointProblem& problem_;
  JointState state_;
  MarginalOptions options_;
};

constexpr double no_sigma_s =
    1e-6;  ///< [m]: below any resolution of the data, the stops stand where commanded

/// Largest sigma_s at which the profile has risen by 1.645^2 / 2: the one-sided 95 % limit.
std::optional<double> upper_limit(SigmaSProfile& profile) {
  const double rise = 0.5 * 1.6448536 * 1.6448536, floor = profile(no_sigma_s);
  double low = 1e-5, high = 1e-4;
  while (high < 10.0 && profile(high) - floor < rise) {
    low = high;
    high *= 2.0;
  }
  if (high >= 10.0) return std::nullopt;
  for (int step = 0; step < 12; ++step) {
    const double middle = std::sqrt(low * high);
    (profile(middle) - floor < rise ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

/// sigma_s at the minimum of the profile, no_sigma_s where it falls to the end. A fixed point in the slopes
/// creeps here: slope and likelihood pull sigma_s against each other, and nearly cancel wherever it is small.
double search_sigma_s(SigmaSProfile& profile) {
  const auto cost = [&](double log_sigma) {
    const double value = profile(std::exp(log_sigma));
    return std::isfinite(value) ? value : 1e100;
  };
  const auto [log_sigma, value] =
      boost::math::tools::brent_find_minima(cost, std::log(1e-5), std::log(1.0), 26);
  return profile(no_sigma_s) <= value + 1e-7 ? no_sigma_s : std::exp(log_sigma);
}

}  // namespace

MarginalFit solve_marginal(const JointProblem& problem, const JointState& start,
                           const MarginalOptions& options) {
  MarginalFit fit;
  fit.state = start;
  if (options.estimate_sigma_s && !fit.state.sigma_s_m) fit.state.sigma_s_m = 0.02;
  MarginalOptions without = options;
  without.estimate_sigma_s = false;
  SigmaSProfile profile(problem, fit.state, without);
  Marginal marginal(problem, start, options);
  const double start_value = marginal.value(fit.state);
  fit.start_nll = marginal.joint_nll;
  if (!std::isfinite(start_value)) {
    fit.reason = "the start lies outside the model's domain, or its stops have no optimum";
    return fit;
  }
  if (options.estimate_sigma_s && !options.held.sigmas) {
    const double sigma_s = search_sigma_s(profile), nll = fit.start_nll;
    fit.state = profile.state();
    fit.state.sigma_s_m = sigma_s;
    marginal.value(fit.state);
    if (sigma_s == no_sigma_s) {
      fit = solve_marginal(problem, JointState(fit.state), without);
      fit.start_nll = nll;
      fit.sigma_s_upper95_m = upper_limit(profile);
      fit.state.sigma_s_m = 0.0;
      return fit;
    }
  }
  // A free sigma_s may be weakly determined and needs the slopes closer.
  const Marginal::Renewal renewal = options.estimate_sigma_s ? Marginal::Renewal{1e-5, 0.0} : Marginal::Renewal{};
  const bool converged = marginal.minimise(fit.state, options.held, options.gradient_tolerance, renewal);
  if (!converged) marginal.value(fit.state, 1e-12);
  fit.joint_nll = marginal.joint_nll;
  fit.marginal_nll = marginal.marginal_nll;
  fit.gradient_norm = marginal.gradient_norm;
  fit.iterations = marginal.iterations;
  fit.evaluations = marginal.evaluations;
  fit.outcome = converged ? Outcome::converged : Outcome::not_converged;
  for (int i : converged ? marginal.vanished() : std::vector<int>{})
    fit.reason += fmt::format("{}{} is drawn to 0 and held: the errors of the stops explain all that it would",
                              fit.reason.empty() ? "" : "; ", i == marginal.layout().sigma_theta ? "sigma_theta" : "sigma_e");
  if (!converged)
    fit.reason = fmt::format("no fixed point after {} iterations; gradient norm {:.1e}", fit.iterations,
                             fit.gradient_norm);
  describe_covariance(marginal.hessian(fit.state), marginal.layout(),
                      free_globals(marginal.layout(), options.held), fit);
  return fit;
}

}  // namespace rangecal
