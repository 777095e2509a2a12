// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/marginal/marginal.hpp"

#include <fmt/core.h>

#include <boost/math/tools/minima.hpp>

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>

#include "joint_ml/newton_step.hpp"
#include "marginal/laplace.hpp"

namespace rangecal {
namespace {

constexpr double infinity = std::numeric_limits<double>::infinity();

/// The marginal likelihood of one problem, with the work space of its solves.
class Marginal {
 public:
  Marginal(const JointProblem& problem, const JointState& start, const MarginalOptions& options)
      : problem_(problem),
        options_(options),
        system_(problem, static_cast<int>(start.alpha.size()), static_cast<int>(start.noise.parameters.size()),
                options.estimate_sigma_s),
        slopes_(Eigen::VectorXd::Zero(layout().sigma_count())),
        polish_(slopes_) {}

  const JointLayout& layout() const { return system_.layout(); }
  JointSystem& system() { return system_; }
  Eigen::VectorXd& slopes() { return slopes_; }
  int evaluations = 0, iterations = 0;
  double gradient_norm = 0.0, joint_nll = 0.0, marginal_nll = 0.0;

  /// Value of l_s + slopes . (logs of) sigma at `state`, whose stops are close to their conditional optimum: what is
  /// left is taken to first order from their decrement. Where they are not close they are settled first.
  double value(JointState& state, double close = 1e-3) {
    joint_nll = system_.assemble(state, HessianKind::exact);
    ++evaluations;
    if (!std::isfinite(joint_nll)) return infinity;
    bool good = system_.eliminate();
    stop_decrement_sq_ = good ? system_.stop_gradient().dot(system_.solve_stops(system_.stop_gradient())) : infinity;
    if (!good || stop_decrement_sq_ > close) {
      joint_nll = settle_stops(system_, state, evaluations);
      if (!std::isfinite(joint_nll)) return infinity;
      stop_decrement_sq_ = system_.stop_gradient().dot(system_.solve_stops(system_.stop_gradient()));
    }
    joint_nll -= 0.5 * stop_decrement_sq_;
    marginal_nll = laplace_nll(system_, joint_nll);
    return marginal_nll + slopes_.dot(sigma_coordinates(state));
  }

  /// Hessian of l_s in the globals, as Newton's method uses it; after value().
  Eigen::MatrixXd hessian(const JointState& state) {
    Eigen::MatrixXd h = system_.schur();
    const int ns = layout().sigma_count();
    h.bottomRightCorner(ns, ns) += system_.log_det_sigma_hessian(state);
    return h;
  }

  /// Newton's method from `state` over the globals not held, the stops moving along. True if the gradient at `state`
  /// fell below the tolerance.
  bool minimise(JointState& state, const Held& held, double tolerance) {
    const std::vector<int> free = free_globals(layout(), held);
    double current = value(state);
    if (!std::isfinite(current)) return false;
    for (int iteration = 0; iteration < options_.max_iterations; ++iteration, ++iterations) {
      Eigen::VectorXd gradient = system_.reduced_gradient() + system_.log_det_gradient(state);
      gradient.tail(layout().sigma_count()) += slopes_;
      std::optional<Eigen::VectorXd> step = newton_step(hessian(state), gradient, free);
      if (!step) step = fisher_step(state, gradient, free);
      if (!step) return false;
      const double decrement_sq = -gradient.dot(*step);
      gradient_norm = std::sqrt(std::max(0.0, decrement_sq));
      if (gradient_norm < tolerance && stop_decrement_sq_ < std::max(1e-13, tolerance * tolerance)) return true;
      limit_step(layout(), state.noise.law, *step);
      const Eigen::VectorXd stops = system_.back_substitute(*step, true);
      bool accepted = false;
      // The log-determinant at stops short of their optimum is off by about a tenth of what they lack [nats].
      const double slack = 1e-11 * (1.0 + std::abs(current)) + 0.3 * std::sqrt(stop_decrement_sq_);
      for (double factor = 1.0; factor > 1e-6; factor *= 0.5) {
        JointState trial = step_state(problem_, layout(), state, factor * *step, factor * stops);
        const double trial_value = value(trial);
        if (std::isfinite(trial_value) && trial_value <= current + slack + 0.3 * std::sqrt(stop_decrement_sq_)) {
          std::swap(state, trial);
          current = trial_value;
          accepted = true;
          break;
        }
      }
      if (!accepted) {
        value(state);
        return gradient_norm < 1e-4;
      }
    }
    return false;
  }

  /// 1/2 log det of the Hessian of l_s in the free part of phi, after value().
  double half_log_det_phi(const Held& held) const {
    Held phi_only = held;
    phi_only.sigmas = true;
    const std::vector<int> free = free_globals(layout(), phi_only);
    if (free.empty()) return 0.0;
    const Eigen::LLT<Eigen::MatrixXd> factor(system_.schur()(free, free));
    if (factor.info() != Eigen::Success) return infinity;
    return factor.matrixLLT().diagonal().array().log().sum();
  }

  /// d(1/2 log det A)/dsigma along phi-hat(sigma), by central differences. phi-hat and the stops are predicted to first
  /// order (what the prediction leaves out is even in the step and cancels). A without the log-determinant's own part
  /// predicts phi-hat only roughly: `polish` puts it right by one Newton step and keeps the difference that this made,
  /// which changes little with sigma, for the renewals after it.
  bool renew_slopes(const JointState& at, const Held& held, bool polish) {
    Held phi_only = held;
    phi_only.sigmas = true;
    Eigen::VectorXd renewed(slopes_.size());
    const std::vector<int> phi = free_globals(layout(), phi_only);
    JointState home = at;
    if (!std::isfinite(value(home))) return false;
    const Eigen::MatrixXd schur = system_.schur();
    std::vector<JointState> moved;
    for (int j = 0; j < slopes_.size(); ++j)
      for (int sign : {1, -1}) {
        Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout().global_count);
        globals[layout().phi_count + j] = sign * step_of(at, j);
        const Eigen::VectorXd pull = schur.col(layout().phi_count + j) * globals[layout().phi_count + j];
        if (const auto follow = newton_step(schur, pull, phi)) globals += *follow;
        moved.push_back(step_state(problem_, layout(), home, globals, system_.back_substitute(globals, false)));
      }
    for (int j = 0; j < slopes_.size(); ++j) {
      double half_log_det[2], predicted[2];
      for (int side = 0; side < 2; ++side) {
        JointState& state = moved[2 * j + side];
        if (!std::isfinite(value(state))) return false;
        predicted[side] = half_log_det_phi(held);
        if (polish) {
          const Eigen::VectorXd gradient = system_.reduced_gradient() + system_.log_det_gradient(state);
          const auto step = newton_step(system_.schur(), gradient, phi);
          if (!step) return false;
          state = step_state(problem_, layout(), state, *step, system_.back_substitute(*step, true));
          if (!std::isfinite(value(state))) return false;
        }
        half_log_det[side] = polish ? half_log_det_phi(held) : predicted[side];
      }
      const double width = 2.0 * step_of(at, j);
      renewed[j] = (half_log_det[0] - half_log_det[1]) / width;
      if (polish)
        polish_[j] = renewed[j] - (predicted[0] - predicted[1]) / width;
      else
        renewed[j] += polish_[j];
    }
    if (!renewed.allFinite()) return false;
    slopes_ = renewed;
    return true;
  }

 private:
  Eigen::VectorXd sigma_coordinates(const JointState& state) const {
    Eigen::VectorXd s(layout().sigma_count());
    if (state.noise.law == NoiseLaw::polynomial)
      s.head(layout().tau_count) = state.noise.parameters;
    else
      s[0] = std::log(state.noise.parameters[0]);
    s[layout().tau_count] = std::log(state.sigma_theta_rad);
    if (layout().sigma_s >= 0) s[layout().tau_count + 1] = std::log(*state.sigma_s_m);
    return s;
  }

  /// Step of the central differences in sigma coordinate j: logs, or a small part of the largest beta.
  double step_of(const JointState& state, int j) const {
    const bool beta = state.noise.law == NoiseLaw::polynomial && j < layout().tau_count;
    return beta ? 1e-3 * state.noise.parameters.cwiseAbs().maxCoeff() : 1e-3;
  }

  std::optional<Eigen::VectorXd> fisher_step(JointState& state, const Eigen::VectorXd& gradient,
                                             const std::vector<int>& free) {
    system_.assemble(state, HessianKind::fisher);
    ++evaluations;
    std::optional<Eigen::VectorXd> step;
    for (double damping = 0.0; damping < 1e6 && !step; damping = std::max(10.0 * damping, 1e-10))
      if (system_.eliminate(damping)) step = newton_step(system_.schur(), gradient, free);
    return step;
  }

  const JointProblem& problem_;
  const MarginalOptions& options_;
  JointSystem system_;
  Eigen::VectorXd slopes_, polish_;
  double stop_decrement_sq_ = 0.0;
};

/// The REML criterion l_s + 1/2 log det A, minimised over all but sigma_s, as a function of sigma_s [m]. `options`
/// without a free sigma_s. Starts where the last value ended; +infinity where there is no optimum.
class SigmaSProfile {
 public:
  SigmaSProfile(const JointProblem& problem, JointState state, const MarginalOptions& options)
      : problem_(problem), state_(std::move(state)), options_(options) {}

  double operator()(double sigma_s) {
    JointState at = state_;
    at.sigma_s_m = sigma_s;
    Marginal marginal(problem_, at, options_);
    const Held& held = options_.held;
    if (!marginal.minimise(at, held, 1e-2)) return infinity;
    for (int renewal = 0; renewal < 2 && !held.sigmas; ++renewal)
      if (!marginal.renew_slopes(at, held, renewal == 0) || !marginal.minimise(at, held, 1e-5)) return infinity;
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

constexpr double no_sigma_s = 1e-6;  ///< [m]: below any resolution of the data, the stops stand where commanded

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

/// sigma_s at the minimum of the profile, no_sigma_s where it falls to the end. A fixed point in the slopes creeps here:
/// slope and likelihood pull sigma_s against each other, and nearly cancel wherever it is small.
double search_sigma_s(SigmaSProfile& profile) {
  const auto cost = [&](double log_sigma) {
    const double value = profile(std::exp(log_sigma));
    return std::isfinite(value) ? value : 1e100;
  };
  const auto [log_sigma, value] = boost::math::tools::brent_find_minima(cost, std::log(1e-5), std::log(1.0), 26);
  return profile(no_sigma_s) <= value + 1e-7 ? no_sigma_s : std::exp(log_sigma);
}

}  // namespace

MarginalFit solve_marginal(const JointProblem& problem, const JointState& start, const MarginalOptions& options) {
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
    if (sigma_s == no_sigma_s) {
      fit = solve_marginal(problem, JointState(fit.state), without);
      fit.start_nll = nll;
      fit.sigma_s_upper95_m = upper_limit(profile);
      fit.state.sigma_s_m = 0.0;
      return fit;
    }
  }
  bool converged = false;
  double change = infinity;  // of the slopes, relative; a free sigma_s may be weakly determined and needs them closer
  const double enough = options.estimate_sigma_s ? 1e-5 : 1e-4, polish_above = options.estimate_sigma_s ? 0.0 : 1e-3;
  // A first guess of the slopes saves a solve; where it cannot be had, they start at zero.
  if (!options.held.sigmas) marginal.renew_slopes(fit.state, options.held, false);
  for (int outer = 0; outer < options.max_outer; ++outer) {
    const bool last = converged || options.held.sigmas;
    const double tolerance = last ? options.gradient_tolerance : outer == 0 ? 1e-2 : 1e-4;
    const bool settled = marginal.minimise(fit.state, options.held, tolerance);
    if (last || !settled) {
      converged = settled;
      break;
    }
    const Eigen::VectorXd before = marginal.slopes();
    if (!marginal.renew_slopes(fit.state, options.held, change > polish_above)) break;
    // What is left is smaller by dc/dsigma over the information of sigma, about 1e-2. A slope error of 1e-6 nats moves
    // a log sigma by 1e-6 / (2 N): far below its standard deviation.
    change = (marginal.slopes() - before).lpNorm<Eigen::Infinity>() / (1.0 + before.norm());
    converged = change < enough && outer > 0;
  }
  marginal.value(fit.state, 1e-12);
  fit.joint_nll = marginal.joint_nll;
  fit.marginal_nll = marginal.marginal_nll;
  fit.gradient_norm = marginal.gradient_norm;
  fit.iterations = marginal.iterations;
  fit.evaluations = marginal.evaluations;
  fit.outcome = converged ? Outcome::converged : Outcome::not_converged;
  if (!converged)
    fit.reason = fmt::format("no fixed point after {} iterations; gradient norm {:.1e}", fit.iterations, fit.gradient_norm);
  describe_covariance(marginal.hessian(fit.state), marginal.layout(), free_globals(marginal.layout(), options.held), fit);
  return fit;
}

}  // namespace rangecal
