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
#include "solver_log.hpp"

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
        further_turn_(Eigen::MatrixXd::Zero(layout().phi_count, layout().sigma_count())) {
    if (!options.begin || options.begin->slopes.size() != slopes_.size() ||
        options.begin->further_turn.rows() != further_turn_.rows())
      return;
    slopes_ = options.begin->slopes;
    further_turn_ = options.begin->further_turn;
    polished_ = true;
  }

  const JointLayout& layout() const { return system_.layout(); }
  JointSystem& system() { return system_; }
  /// After minimise(): the sigmas (as globals) that the likelihood draws to 0.
  const std::vector<int>& vanished() const { return vanished_; }
  std::optional<RemlSlopes> reml() const {
    return polished_ ? std::optional(RemlSlopes{slopes_, further_turn_}) : std::nullopt;
  }
  int evaluations = 0, iterations = 0;
  double gradient_norm = 0.0, joint_nll = 0.0, marginal_nll = 0.0;

  /// Value of l_s + slopes . (logs of) sigma at `state`, whose stops should be close to their conditional optimum:
  /// the rest of the way is accounted for by their Newton decrement. Stops that are not close are first moved to the
  /// optimum.
  double value(JointState& state, double close = near_optimum) {
    joint_nll = system_.assemble(state, HessianKind::exact);
    ++evaluations;
    if (!std::isfinite(joint_nll)) return infinity;
    bool good = system_.eliminate();
    stop_decrement_sq_ =
        good ? system_.stop_gradient().dot(system_.solve_stops(system_.stop_gradient())) : infinity;
    if (!good || stop_decrement_sq_ > close) {
      joint_nll = settle_stops(system_, state, evaluations, close);
      if (!std::isfinite(joint_nll)) return infinity;
      stop_decrement_sq_ = system_.stop_gradient().dot(system_.solve_stops(system_.stop_gradient()));
    }
    joint_nll -= 0.5 * stop_decrement_sq_;
    marginal_nll = laplace_nll(system_, joint_nll);
    return objective(state);
  }

  /// Hessian of l_s in the globals, as Newton's method uses it; after value().
  Eigen::MatrixXd hessian(const JointState& state) {
    Eigen::MatrixXd h = system_.schur();
    const int ns = layout().sigma_count();
    h.bottomRightCorner(ns, ns) += system_.log_det_sigma_hessian(state);
    return h;
  }

  /// How accurately minimise() recomputes the REML slopes.
  struct Renewal {
    double enough = 1e-4;        ///< relative change of the slopes below which they are kept
    double polish_above = 1e-3;  ///< their change above which d phi-hat / dsigma is measured again
  };
  /// A free sigma_s may be weakly determined and needs more accurate slopes.
  static Renewal renewal_for(const MarginalOptions& options) {
    if (options.estimate_sigma_s) return {1e-5, 0.0};
    return {std::max(1e-4, options.gradient_tolerance), 1e-3};
  }

  /// Indices of the globals that may move.
  std::vector<int> free_of(const Held& held) const {
    std::vector<int> free = free_globals(layout(), held);
    if (options_.held_sigma)
      std::erase_if(free, [&](int i) {
        return i >= layout().phi_count &&
               (*options_.held_sigma == Sigma::theta ? i == layout().sigma_theta : i < layout().sigma_theta);
      });
    return free;
  }

  /// Step of the differences in sigma coordinate j: in logarithms, or for a beta a small part of the largest one.
  double step_of(const JointState& state, Eigen::Index j) const {
    const bool beta = !has_sigma(state.noise.law) && j < layout().tau_count;
    return beta ? 1e-4 * state.noise.parameters.cwiseAbs().maxCoeff() : 1e-4;
  }

  /// After value(state): Newton's method over the globals not held; the stops move along. With `renewal` the slopes are
  /// recomputed at every step until they no longer change; otherwise they are kept. True if the gradient at `state` fell
  /// below the tolerance and the slopes had converged.
  bool minimise(JointState& state, const Held& held, double tolerance, const std::optional<Renewal>& renewal,
                const SolverLog& log) {
    std::vector<int> free = free_of(held);
    vanished_.clear();
    bool settled = !renewal || held.sigmas;
    double change = infinity;
    int renewals = 0;
    Eigen::VectorXd last_step;
    double last_norm = 0.0;
    double close = near_optimum;  // how close to their optimum the stops are where values are compared
    for (int iteration = 0; iteration < options_.max_iterations; ++iteration, ++iterations) {
      Eigen::VectorXd gradient = system_.reduced_gradient() + system_.log_det_gradient(state);
      const Eigen::MatrixXd curvature = hessian(state);
      const bool near = iteration > 0 ? gradient_norm < near_norm
                                      : polished_ && decrement(curvature, gradient, free) < near_norm;
      // Far from the optimum slopes of a solve before are as good as those of a state that is left at once.
      if (!settled && (near || !polished_)) {
        if (++renewals > options_.max_outer) return false;
        const bool polish = near && (!polished_ || change > renewal->polish_above);
        const Eigen::VectorXd before = slopes_;
        const bool renewed = renew_slopes(state, held, gradient, polish);
        if (!renewed && near) return false;  // far from the optimum the old slopes are kept
        // The error that is left is smaller than this change by dc/dsigma over the information of sigma, about 1e-2. A slope
        // error of 1e-6 nats moves a log sigma by 1e-6 / (2 N): far below its standard deviation.
        change = renewed ? (slopes_ - before).lpNorm<Eigen::Infinity>() / (1.0 + before.norm()) : infinity;
        settled = near && polished_ && change < renewal->enough;
      }
      const double current = objective(state);
      gradient.tail(layout().sigma_count()) += slopes_;
      std::erase_if(free, [&](int i) {
        const bool gone = i >= layout().phi_count && is_logarithm(state, i) && gradient[i] > 0.0 &&
                          gradient[i] < vanishing_gradient && curvature(i, i) < vanishing_curvature;
        if (gone) vanished_.push_back(i);
        return gone;
      });
      std::optional<Eigen::VectorXd> step = newton_step(curvature, gradient, free);
      if (!step) step = fisher_step(state, gradient, free);
      if (!step) return false;
      const double decrement_sq = -gradient.dot(*step);
      gradient_norm = std::sqrt(std::max(0.0, decrement_sq));
      if (settled && gradient_norm < tolerance &&
          stop_decrement_sq_ < std::max(1e-13, tolerance * tolerance)) {
        log.iteration(iterations + 1, marginal_nll, 0.0, gradient_norm, {"length", 1.0});
        return true;
      }
      // This step goes back by nearly the length of the last one. The curvature does not include the changes of the slopes
      // and of the log-determinant, and is too small in this direction: by the factor by which the last step was too long.
      const double before = last_step.size() > 0 ? last_norm : 0.0,
                   ratio = before > 0.0 ? gradient_norm / before : 0.0;
      if (ratio > 0.3 && -gradient.dot(last_step) < -0.5 * gradient_norm * before) *step /= 1.0 + ratio;
      limit_step(layout(), state.noise.law, *step);
      const Eigen::VectorXd stops = system_.back_substitute(*step, true);
      bool accepted = false;
      // With stops short of their optimum the log-determinant is off by about a tenth of what they have left to gain [nats]; in a
      // poor model by more. Where the whole step fails near the optimum, another is taken from stops at theirs.
      const double slack = 1e-11 * (1.0 + std::abs(current)) + 0.3 * std::sqrt(stop_decrement_sq_);
      const bool may_settle = gradient_norm < near_norm && close > at_optimum;
      for (double factor = 1.0; factor > (may_settle ? 0.5 : 1e-6); factor *= 0.5) {
        JointState trial = step_state(problem_, layout(), state, factor * *step, factor * stops);
        const double trial_value = value(trial, close);
        if (std::isfinite(trial_value) &&
            trial_value <= current + slack + 0.3 * std::sqrt(stop_decrement_sq_)) {
          std::swap(state, trial);
          accepted = true;
          last_step = factor * *step;
          last_norm = std::sqrt(std::max(0.0, last_step.dot(curvature * last_step)));
          log.iteration(iterations + 1, marginal_nll, last_norm, gradient_norm, {"length", factor});
          break;
        }
      }
      if (!accepted && may_settle) {
        close = at_optimum;
        if (!std::isfinite(value(state, close))) return false;
        continue;
      }
      if (!accepted) {
        log.iteration(iterations + 1, marginal_nll, 0.0, gradient_norm, {"length", 0.0});
        break;
      }
    }
    // Here because of rounding, or because of slow convergence: A lacks the log-determinant's own curvature, which matters
    // where the stops explain nearly all of the readings.
    return std::isfinite(value(state)) && settled && gradient_norm < 1e-4;
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

 private:
  static constexpr double infinity = std::numeric_limits<double>::infinity();
  // If a sigma goes to 0, slope and curvature in its logarithm go to 0 too. At these limits the logarithm has a standard
  // deviation of 10, and a thousandth of a nat is left to gain. The sigma is then held where it is.
  static constexpr double vanishing_gradient = 1e-3, vanishing_curvature = 1e-2;
  static constexpr double near_norm =
      0.1;  ///< Newton decrement below which d phi-hat / dsigma is close to that at the optimum
  // Square of the stops' Newton decrement where they count as close to their optimum, and as at it.
  static constexpr double near_optimum = 1e-3, at_optimum = 1e-14;

  /// The slopes c = d(1/2 log det A)/dsigma along phi-hat(sigma), after value(state); `gradient`: that of l_s. A lacks the
  /// log-determinant's own curvature, so it predicts d phi-hat / dsigma only roughly. `polish` measures the gradient that is
  /// left after such a move, and keeps the resulting correction, which changes little with sigma, for later calls.
  bool renew_slopes(JointState& state, const Held& held, const Eigen::VectorXd& gradient, bool polish) {
    Held phi_only = held;
    phi_only.sigmas = true;
    const std::vector<int> phi = free_globals(layout(), phi_only);
    const Eigen::Index phis = layout().phi_count, ns = layout().sigma_count();
    const Eigen::LLT<Eigen::MatrixXd> factor(system_.schur()(phi, phi));
    if (factor.info() != Eigen::Success) return false;
    Eigen::MatrixXd covariance = Eigen::MatrixXd::Zero(phis, phis);
    const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(factor.rows(), factor.rows()));
    covariance(phi, phi) = inverse;
    const Eigen::VectorXd slope = system_.log_det_phi_gradient(state, covariance);
    const Eigen::MatrixXd turn = -covariance * system_.schur().topRightCorner(phis, ns);
    if (polish) {
      std::vector<JointState> moved;
      for (Eigen::Index j = 0; j < ns; ++j) {
        Eigen::VectorXd globals = Eigen::VectorXd::Zero(layout().global_count);
        globals.head(phis) = step_of(state, j) * turn.col(j);
        globals[phis + j] = step_of(state, j);
        moved.push_back(
            step_state(problem_, layout(), state, globals, system_.back_substitute(globals, false)));
      }
      for (Eigen::Index j = 0; j < ns; ++j) {
        if (!std::isfinite(value(moved[j]))) return false;
        const Eigen::VectorXd there = system_.reduced_gradient() + system_.log_det_gradient(moved[j]);
        further_turn_.col(j) = -covariance * (there - gradient).head(phis) / step_of(state, j);
      }
      polished_ = true;
      if (!std::isfinite(value(state))) return false;
    }
    const Eigen::VectorXd renewed = slope.tail(ns) + (turn + further_turn_).transpose() * slope.head(phis);
    if (!renewed.allFinite()) return false;
    slopes_ = renewed;
    return true;
  }

  /// l_s + slopes . (logs of) sigma, after value(state).
  double objective(const JointState& state) const {
    return marginal_nll + slopes_.dot(sigma_coordinates(state, layout().sigma_s >= 0));
  }

  /// Newton decrement of the objective with the slopes as they are; infinite where there is no step. `gradient`: that of l_s.
  double decrement(const Eigen::MatrixXd& curvature, Eigen::VectorXd gradient,
                   const std::vector<int>& free) const {
    gradient.tail(layout().sigma_count()) += slopes_;
    const std::optional<Eigen::VectorXd> step = newton_step(curvature, gradient, free);
    return step ? std::sqrt(std::max(0.0, -gradient.dot(*step))) : infinity;
  }

  bool is_logarithm(const JointState& state, int global) const {
    return has_sigma(state.noise.law) || global >= layout().sigma_theta;
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
  Eigen::VectorXd slopes_;
  Eigen::MatrixXd further_turn_;  ///< d phi-hat / dsigma beyond what A predicts
  bool polished_ = false;
  std::vector<int> vanished_;
  double stop_decrement_sq_ = 0.0;
};

}  // namespace rangecal
