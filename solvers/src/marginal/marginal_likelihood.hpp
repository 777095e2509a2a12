// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <cmath>
#include <limits>
#include <optional>
#include <utility>
#include <vector>

#include "joint_ml/newton_step.hpp"
#include "marginal/laplace.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {

/// The marginal likelihood of one problem, with the work space of its solves.
class Marginal {
 public:
  Marginal(const JointProblem& problem, const JointState& start, const MarginalOptions& options)
      : problem_(problem),
        options_(options),
        system_(problem, static_cast<int>(start.alpha.size()),
                static_cast<int>(start.noise.parameters.size()), options.estimate_sigma_s),
        slopes_(Eigen::VectorXd::Zero(layout().sigma_count())),
        polish_(slopes_) {}

  const JointLayout& layout() const { return system_.layout(); }
  JointSystem& system() { return system_; }
  Eigen::VectorXd& slopes() { return slopes_; }
  int evaluations = 0, iterations = 0;
  double gradient_norm = 0.0, joint_nll = 0.0, marginal_nll = 0.0;

  /// Value of l_s + slopes . (logs of) sigma at `state`, whose stops are close to their conditional optimum:
  /// what is left is taken to first order from their decrement. Where they are not close they are settled
  /// first.
  double value(JointState& state, double close = 1e-3) {
    joint_nll = system_.assemble(state, HessianKind::exact);
    ++evaluations;
    if (!std::isfinite(joint_nll)) return infinity;
    bool good = system_.eliminate();
    stop_decrement_sq_ =
        good ? system_.stop_gradient().dot(system_.solve_stops(system_.stop_gradient())) : infinity;
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

  /// Newton's method from `state` over the globals not held, the stops moving along. True if the gradient at
  /// `state` fell below the tolerance.
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
      if (gradient_norm < tolerance && stop_decrement_sq_ < std::max(1e-13, tolerance * tolerance))
        return true;
      limit_step(layout(), state.noise.law, *step);
      const Eigen::VectorXd stops = system_.back_substitute(*step, true);
      bool accepted = false;
      // The log-determinant at stops short of their optimum is off by about a tenth of what they lack [nats].
      const double slack = 1e-11 * (1.0 + std::abs(current)) + 0.3 * std::sqrt(stop_decrement_sq_);
      for (double factor = 1.0; factor > 1e-6; factor *= 0.5) {
        JointState trial = step_state(problem_, layout(), state, factor * *step, factor * stops);
        const double trial_value = value(trial);
        if (std::isfinite(trial_value) &&
            trial_value <= current + slack + 0.3 * std::sqrt(stop_decrement_sq_)) {
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

  /// d(1/2 log det A)/dsigma along phi-hat(sigma), by central differences. phi-hat and the stops are
  /// predicted to first order (what the prediction leaves out is even in the step and cancels). A without the
  /// log-determinant's own part predicts phi-hat only roughly: `polish` puts it right by one Newton step and
  /// keeps the difference that this made, which changes little with sigma, for the renewals after it.
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
        moved.push_back(
            step_state(problem_, layout(), home, globals, system_.back_substitute(globals, false)));
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
  static constexpr double infinity = std::numeric_limits<double>::infinity();

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

}  // namespace rangecal
