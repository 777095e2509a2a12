// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/joint_ml/joint_ceres.hpp"

#include <ceres/iteration_callback.h>
#include <ceres/manifold.h>
#include <ceres/ordered_groups.h>
#include <ceres/problem.h>
#include <ceres/solver.h>
#include <fmt/core.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <cmath>
#include <deque>
#include <memory>

#include "joint_ml/blocks.hpp"
#include "joint_ml/ceres_costs.hpp"
#include "joint_ml/collapse.hpp"
#include "joint_ml/newton_step.hpp"
#include "rangecal/problems/landmarks/joint_nll.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"
#include "solver_log.hpp"

namespace rangecal {
namespace {

/// Whitens alpha over the seed's distances: T with T^T (sum R p p^T / s^2) T = 1, p the powers of d.
Eigen::MatrixXd whitened_basis(const JointProblem& problem, const JointState& state) {
  const Eigen::Index n = state.alpha.size();
  const Cells& c = problem.cells;
  Eigen::MatrixXd information = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd power(n);
  for (std::size_t i = 0; i < c.size(); ++i) {
    const double d = Sight(state.landmarks[c.landmark[i]], state.stops[c.stop[i]], c.radius_m[i]).d;
    power[0] = 1.0;
    for (Eigen::Index a = 1; a < n; ++a) power[a] = d * power[a - 1];
    const double s = state.noise.spread(d, power.dot(state.alpha));
    information += (c.count[i] / (s * s)) * power * power.transpose();
  }
  const Eigen::VectorXd scale = information.diagonal().cwiseSqrt().cwiseInverse();
  const Eigen::LLT<Eigen::MatrixXd> factor(scale.asDiagonal() * information * scale.asDiagonal());
  if (factor.info() != Eigen::Success) return scale.asDiagonal();
  return scale.asDiagonal() * Eigen::MatrixXd(factor.matrixU()).inverse();
}

/// The problem as Ceres sees it, with the unknowns it moves.
class Program : public ceres::IterationCallback {
 public:
  Program(const JointProblem& problem, const JointState& start, const JointLayout& layout, const Held& held,
          const SolverLog& log)
      : problem_(problem),
        start_(start),
        layout_(layout),
        held_(held),
        log_(log),
        curve_block_(start, whitened_basis(problem, start)),
        coordinates_(layout.coordinates, 0.0),
        curve_(start.alpha.size(), 0.0),
        alpha_count_(start.alpha.size()),
        program_(program_options()) {
    for (const Eigen::Vector2d& m : start.landmarks) landmarks_.insert(landmarks_.end(), {m.x(), m.y()});
    if (!has_sigma(start.noise.law))
      curve_.insert(curve_.end(), start.noise.parameters.begin(), start.noise.parameters.end());
    else
      curve_.push_back(std::log(start.noise.parameters[0]));
    curve_.push_back(std::log(start.sigma_theta_rad));
    add_blocks();
    add_links();
    program_.AddParameterBlock(curve_.data(), static_cast<int>(curve_.size()));
    hold_curve();
    for (int l = 0; held.landmarks && l < problem.landmark_count(); ++l)
      if (program_.HasParameterBlock(&landmarks_[2 * l]))
        program_.SetParameterBlockConstant(&landmarks_[2 * l]);
  }

  JointState state() const {
    JointState now = start_;
    if (!held_.alpha)
      now.alpha += curve_block_.basis * Eigen::Map<const Eigen::VectorXd>(curve_.data(), alpha_count_);
    if (!held_.sigmas) {
      if (!has_sigma(now.noise.law))
        std::copy(curve_.begin() + alpha_count_, curve_.end() - 1, now.noise.parameters.begin());
      else
        now.noise.parameters[0] = std::exp(curve_[alpha_count_]);
      now.sigma_theta_rad = std::exp(curve_.back());
    }
    for (std::size_t l = 0; l < now.landmarks.size(); ++l)
      now.landmarks[l] = Eigen::Vector2d(landmarks_[2 * l], landmarks_[2 * l + 1]);
    const Eigen::VectorXd still = Eigen::VectorXd::Zero(layout_.global_count);
    return step_state(problem_, layout_, now, still,
                      Eigen::Map<const Eigen::VectorXd>(coordinates_.data(),
                                                        static_cast<Eigen::Index>(coordinates_.size())));
  }

  /// One run of Ceres's trust region, from where the joint NLL is `nll`, after `before` iterations of others.
  ceres::Solver::Summary run(int iterations, double nll, int before) {
    nll_start_ = nll;
    before_ = before;
    ceres::Solver::Options options;
    options.max_num_iterations = iterations;
    options.max_num_consecutive_invalid_steps = 100;
    options.function_tolerance = 0.0;
    options.gradient_tolerance = 0.0;
    // Metres and logs of order one against standard deviations of 1e-4 and more.
    options.parameter_tolerance = 1e-11;
    options.initial_trust_region_radius = 1e2;  // a first step too far takes many halvings of a larger one
    options.max_trust_region_radius = 1e16;
    options.jacobi_scaling = false;         // the unknowns are of like size already
    options.use_nonmonotonic_steps = true;  // the last decreases drown in the rounding of the sum of squares
    options.logging_type = ceres::SILENT;
    options.callbacks.push_back(this);
    options.update_state_every_iteration = true;
    options.linear_solver_type =
        layout_.coordinates == 0 ? ceres::DENSE_NORMAL_CHOLESKY : ceres::SPARSE_NORMAL_CHOLESKY;
    options.linear_solver_ordering = std::make_shared<ceres::ParameterBlockOrdering>();
    // Stops first. Ceres orders the blocks of a group by address: one vector a group, or the last bits would
    // change from run to run.
    const std::vector<double>* const vectors[] = {&coordinates_, &curve_, &landmarks_};
    std::vector<double*> blocks;
    program_.GetParameterBlocks(&blocks);
    for (double* block : blocks)
      for (int group = 0; group < 3; ++group)
        if (block >= vectors[group]->data() && block < vectors[group]->data() + vectors[group]->size())
          options.linear_solver_ordering->AddElementToGroup(block, group);
    ceres::Solver::Summary summary;
    silence_ceres();
    ceres::Solve(options, &program_, &summary);
    return summary;
  }

  /// Moves the references of the floors' level to the present values.
  bool set_reference() {
    const Cells& c = problem_.cells;
    for (std::size_t i = 0; i < c.size(); ++i)
      if (!cell_costs_[i].residual().set_reference(parameters_of(c.stop[i], c.landmark[i]).data()))
        return false;
    bearing_cost_->residual().log_reference = curve_.back();
    return true;
  }

  ceres::CallbackReturnType operator()(const ceres::IterationSummary& step) override {
    if (step.iteration == 0) offset_ = nll_start_ - step.cost;
    log_.iteration(before_ + step.iteration + 1, offset_ + step.cost,
                   step.step_is_successful ? step.step_norm : 0.0, step.gradient_norm,
                   {"radius", step.trust_region_radius});
    // A gain of 1e-11 nats, of which the next step may find a twentieth, leaves a gradient norm of 1e-6.
    const double rounding = 1e-15 * step.cost;
    if (step.iteration > 0 && step.step_is_successful &&
        std::abs(step.cost_change) < std::max(1e-11, rounding))
      return ceres::SOLVER_TERMINATE_SUCCESSFULLY;
    if (held_.sigmas) return ceres::SOLVER_CONTINUE;
    JointState now = start_;
    now.sigma_theta_rad = std::exp(curve_.back());
    if (has_sigma(now.noise.law)) now.noise.parameters[0] = std::exp(curve_[alpha_count_]);
    collapsed = collapsed_sigma(start_, now);
    return collapsed.empty() ? ceres::SOLVER_CONTINUE : ceres::SOLVER_TERMINATE_SUCCESSFULLY;
  }

  std::string collapsed;

 private:
  static ceres::Problem::Options program_options() {
    ceres::Problem::Options options;
    options.cost_function_ownership = ceres::DO_NOT_TAKE_OWNERSHIP;
    options.disable_all_safety_checks = true;
    return options;
  }

  void hold_curve() {
    std::vector<int> constant;
    for (int i = 0; i < static_cast<int>(curve_.size()); ++i)
      if (i < alpha_count_ ? held_.alpha : held_.sigmas) constant.push_back(i);
    if (constant.size() == curve_.size())
      program_.SetParameterBlockConstant(curve_.data());
    else if (!constant.empty())
      program_.SetManifold(curve_.data(),
                           new ceres::SubsetManifold(static_cast<int>(curve_.size()), constant));
  }

  std::vector<double*> parameters_of(int stop, int landmark) {
    std::vector<double*> blocks = {curve_.data()};
    const JointLayout::Node& node = layout_.nodes[layout_.node_of_stop[stop]];
    if (node.dim > 0) blocks.push_back(&coordinates_[node.coordinate]);
    blocks.push_back(&landmarks_[2 * landmark]);
    return blocks;
  }

  void add_blocks() {
    const Cells& c = problem_.cells;
    for (int k = 0; k < problem_.stop_count(); ++k) {
      const JointLayout::Node& node = layout_.nodes[layout_.node_of_stop[k]];
      const StopBlock stop{start_.stops[k], node.dim, node.free_position,
                           node.heading[layout_.slot_of_stop[k]]};
      for (int i = c.stop_begin[k]; i < c.stop_begin[k + 1]; ++i)
        program_.AddResidualBlock(
            &cell_costs_.emplace_back(CellResidual(problem_, curve_block_, start_, stop, i)), nullptr,
            parameters_of(k, c.landmark[i]));
      const StopPriorResidual prior(problem_.stops[k], sigma_xy_of(problem_, start_, k), stop);
      if (prior.residual_count() > 0)
        program_.AddResidualBlock(&prior_costs_.emplace_back(prior), nullptr, &coordinates_[node.coordinate]);
    }
    BearingSpreadResidual bearing;
    for (std::size_t i = 0; i < problem_.cells.size(); ++i)
      bearing.square_sum += problem_.cells.bearing_weight[i] * problem_.cells.bearing_mean_square[i];
    bearing.readings = problem_.readings;
    bearing.log_reference = curve_.back();
    bearing.block_size = static_cast<int>(curve_.size());
    bearing.index = bearing.block_size - 1;
    bearing_cost_ = std::make_unique<BearingSpreadCost>(bearing);
    program_.AddResidualBlock(bearing_cost_.get(), nullptr, curve_.data());
  }

  void add_links() {
    for (int k = 1; k < problem_.stop_count(); ++k) {
      if (!problem_.stops[k].chained) continue;
      LinkCost& link = link_costs_.emplace_back(problem_, layout_, start_, k);
      if (link.num_residuals() == 0 || link.nodes().empty()) continue;
      std::vector<double*> blocks;
      for (int node : link.nodes()) blocks.push_back(&coordinates_[layout_.nodes[node].coordinate]);
      program_.AddResidualBlock(&link, nullptr, blocks);
    }
    for (const KnownDistance& taped : problem_.known_distances)
      program_.AddResidualBlock(&taped_costs_.emplace_back(taped), nullptr, &landmarks_[2 * taped.from],
                                &landmarks_[2 * taped.to]);
  }

  const JointProblem& problem_;
  const JointState& start_;
  const JointLayout& layout_;
  const Held held_;
  const SolverLog& log_;
  int before_ = 0;        ///< iterations of the runs before
  double offset_ = 0.0;   ///< joint NLL less the cost of this run, whose floors differ from the last one's
  double nll_start_ = 0;  ///< joint NLL where this run starts
  const CurveBlock curve_block_;
  std::vector<double> coordinates_, curve_, landmarks_;
  std::deque<CellCost> cell_costs_;  ///< one per cell, in their order
  std::deque<StopPriorCost> prior_costs_;
  std::unique_ptr<BearingSpreadCost> bearing_cost_;
  std::deque<LinkCost> link_costs_;
  std::deque<TapedCost> taped_costs_;
  Eigen::Index alpha_count_;
  ceres::Problem program_;
};

JointFit ceres_fit(const JointProblem& problem, const JointState& given, const JointOptions& options,
                   const SolverLog& log) {
  JointState start = given;
  share_places(problem.stops, start.stops);
  JointFit fit;
  fit.state = start;
  JointSystem system(problem, static_cast<int>(start.alpha.size()),
                     static_cast<int>(start.noise.parameters.size()));
  const std::vector<int> free = free_globals(system.layout(), options.held);
  fit.start_nll = fit.joint_nll = system.assemble(start, HessianKind::fisher);
  if (cannot_start(problem, options.held, fit)) return fit;
  Program program(problem, start, system.layout(), options.held, log);
  double last_norm = std::numeric_limits<double>::infinity();
  for (int run = 0; run < 20 && fit.iterations < options.max_iterations; ++run) {
    if (run > 0 && !program.set_reference()) break;
    const ceres::Solver::Summary summary =
        program.run(options.max_iterations - fit.iterations, fit.joint_nll, fit.iterations);
    fit.iterations += static_cast<int>(summary.iterations.size());
    fit.evaluations += summary.num_residual_evaluations + summary.num_jacobian_evaluations;
    fit.state = program.state();
    if (!program.collapsed.empty()) {
      fit.outcome = Outcome::unbounded;
      fit.reason =
          "the joint likelihood has no maximum here: " + program.collapsed + "; use the marginal method";
      fit.joint_nll = joint_nll(problem, fit.state);
      return fit;
    }
    fit.joint_nll = system.assemble(fit.state, HessianKind::fisher);
    ++fit.evaluations;
    if (!system.eliminate()) break;
    const auto step = newton_step(system.schur(), system.reduced_gradient(), free);
    if (!step) break;
    const Eigen::VectorXd stops = system.back_substitute(*step, true);
    fit.gradient_norm =
        std::sqrt(std::max(0.0, -(system.global_gradient().dot(*step) + system.stop_gradient().dot(stops))));
    // Ceres compares sums of squares, whose rounding is about 1e-16 of N: no smaller norm can be told from
    // its gain.
    const double rounding = std::max(1e-6, std::sqrt(1e-14 * problem.readings));
    const bool stalled = fit.gradient_norm < rounding && fit.gradient_norm > 0.5 * last_norm;
    if (fit.gradient_norm < std::max(1e-6, options.gradient_tolerance) || stalled) {
      fit.outcome = Outcome::converged;
      break;
    }
    last_norm = fit.gradient_norm;
  }
  if (fit.outcome != Outcome::converged) {
    fit.outcome = Outcome::not_converged;
    fit.reason = fmt::format("no optimum after {} iterations; gradient norm {:.1e}", fit.iterations,
                             fit.gradient_norm);
  }
  if (system.eliminate()) describe_covariance(system.schur(), system.layout(), free, fit);
  return fit;
}

}  // namespace

JointFit solve_joint_ceres(const JointProblem& problem, const JointState& start,
                           const JointOptions& options) {
  return followed("full ceres", start.alpha.size(), start.noise.law, &JointFit::joint_nll,
                  [&](const SolverLog& log) { return ceres_fit(problem, start, options, log); });
}

}  // namespace rangecal
