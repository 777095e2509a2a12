// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>
#include <vector>

#include "solver_log.hpp"

namespace rangecal::diagnosis {

/// Gradient of the log likelihood in the fitted parameters, their information matrix, and which of them stay where they are.
struct ScoringSlopes {
  Eigen::VectorXd score;
  Eigen::MatrixXd information;
  std::vector<Eigen::Index> held;
};

/// What the information matrix I lacks of the Hessian of the NLL, learned from the gradients at both ends of every step: with
/// step s, change of gradient y, and H = I + t C
///
///   C <- t C + y y^T / (y^T s) - H s s^T H / (s^T H s),   t = min(1, |s^T (y - I s)| / |s^T C s|)
///
/// where y^T s, if less than a tenth of s^T H s, is raised to that by a part of H s, so that H stays positive.
/// Source: Broyden, Fletcher, Goldfarb and Shanno 1970, damped by Powell 1978, sized by Dennis, Gay and Welsch 1981.
class LackOfInformation {
 public:
  explicit LackOfInformation(Eigen::Index n) : lack_(Eigen::MatrixXd::Zero(n, n)) {}
  /// What was learned on the way to a fit close by.
  explicit LackOfInformation(Eigen::MatrixXd known) : lack_(std::move(known)) {}

  const Eigen::MatrixXd& matrix() const { return lack_; }

  void learn(const Eigen::VectorXd& step, Eigen::VectorXd change, const Eigen::MatrixXd& information) {
    constexpr double least_share = 0.1;
    const Eigen::VectorXd known = information * step;
    const double of_lack = std::abs(step.dot(lack_ * step));
    if (of_lack > 0.0) lack_ *= std::min(1.0, std::abs(step.dot(change - known)) / of_lack);
    Eigen::VectorXd Hs = known + lack_ * step;
    double sHs = step.dot(Hs);
    if (!(sHs > 1e-6 * step.dot(known))) {  // no longer positive beside the information of the new point
      lack_.setZero();
      Hs = known;
      sHs = step.dot(Hs);
    }
    if (!(sHs > 0.0)) return;
    const double along = step.dot(change);
    if (along < least_share * sHs) {
      const double part = (1.0 - least_share) * sHs / (sHs - along);
      change = part * change + (1.0 - part) * Hs;
    }
    lack_ += change * change.transpose() / step.dot(change) - Hs * Hs.transpose() / sHs;
  }

  /// H is given the curvature along a step over which the NLL fell by `gain` (rose, where negative) though its slope promised `slope`,
  /// but no more than puts the least value along the step at a tenth of it.
  void learn_curvature(const Eigen::VectorXd& step, double slope, double gain,
                       const Eigen::MatrixXd& information) {
    const Eigen::VectorXd Hs = information * step + lack_ * step;
    const double predicted = step.dot(Hs), curvature = std::min(2.0 * (slope - gain), 10.0 * slope);
    if (predicted > 0.0 && curvature > predicted)
      lack_ += (curvature - predicted) / (predicted * predicted) * Hs * Hs.transpose();
  }

  /// Halves C, and leaves it out at last, until I + C is positive: what was learned elsewhere may outweigh the information here.
  void stay_positive(const Eigen::MatrixXd& information) {
    constexpr int most_halvings = 3;
    const Eigen::VectorXd scale = information.diagonal().cwiseMax(1e-300).cwiseSqrt().cwiseInverse();
    for (int halving = 0; halving <= most_halvings; ++halving) {
      Eigen::MatrixXd scaled = scale.asDiagonal() * (information + lack_) * scale.asDiagonal();
      scaled.diagonal().array() += 1e-9;
      if (Eigen::LLT<Eigen::MatrixXd>(scaled).info() == Eigen::Success) return;
      lack_ *= 0.5;
    }
    lack_.setZero();
  }

 private:
  Eigen::MatrixXd lack_;
};

/// A step of the fitted parameters [size of the information], the others held.
struct ScoringStep {
  Eigen::VectorXd step;
  double slope = 0.0;  ///< score^T step [nats]
};

/// (H + lambda diag H)^-1 score, of which the parameters `held` take no part. None where H, so damped, has no positive pivots.
inline std::optional<ScoringStep> damped_step(const ScoringSlopes& at, const Eigen::MatrixXd& hessian,
                                              double damping, const std::vector<bool>& held) {
  constexpr double least_share = 0.01;  // of the information's diagonal, which H may fall short of
  std::vector<Eigen::Index> free;
  for (Eigen::Index a = 0; a < at.score.size(); ++a)
    if (!held[static_cast<std::size_t>(a)]) free.push_back(a);
  const Eigen::VectorXd scale = hessian.diagonal()
                                    .cwiseMax(least_share * at.information.diagonal())
                                    .cwiseMax(1e-300)(free)
                                    .cwiseSqrt()
                                    .cwiseInverse();
  Eigen::MatrixXd scaled = scale.asDiagonal() * hessian(free, free) * scale.asDiagonal();
  scaled.diagonal().array() += damping + 1e-9;
  const Eigen::LDLT<Eigen::MatrixXd> factor(scaled);
  const Eigen::VectorXd own = scale.cwiseProduct(factor.solve(scale.cwiseProduct(at.score(free))));
  if (factor.info() != Eigen::Success || !factor.isPositive() || !own.allFinite()) return std::nullopt;
  ScoringStep out{Eigen::VectorXd::Zero(at.score.size())};
  out.step(free) = own;
  out.slope = at.score.dot(out.step);
  return out;
}

/// Steps of a fit to the end, at most.
inline constexpr int many_steps = 40;

/// Steps from `here` to where the likelihood is highest, until the predicted gain of a step is negligible:
///
///   step = (H + lambda diag H)^-1 score,   H = I + C
///
/// I is the information, C what it lacks of the Hessian, lambda Levenberg's damping, 0 as long as steps gain what is predicted.
/// A step is accepted if it lowers the NLL; over one that does not H learns its curvature. A Point has an `nll` [nats];
/// slopes(point) gives ScoringSlopes, within(point, step) the part of a step that bounds leave, moved(point, step) the point such a
/// step away. A parameter that has no way to go is held, and the step of the others solved for without it. `lack` is C to begin with, and
/// then as it was learned. `name` is that of the solver in the log.
template <typename Point, typename SlopesAt, typename Within, typename Moved>
Point scored(const char* name, Point here, const SlopesAt& slopes, const Within& within, const Moved& moved,
             LackOfInformation& lack, int most_steps = many_steps) {
  constexpr int most_failures = 6, most_dampings = 12;
  constexpr double settled = 2e-3;                                           // nats
  constexpr double first_damping = 1e-2, more = 10.0, least_damping = 1e-3;  // lambda
  constexpr double as_predicted = 0.75, far_from_predicted = 0.25;           // gain / predicted gain
  const SolverLog log(name);
  double damping = 0.0;
  const auto ended = [&](int iterations, const char* why) {
    log.end(iterations, here.nll, why);
    return std::move(here);
  };
  const auto damp_more = [&] { damping = std::max(first_damping, more * damping); };
  ScoringSlopes at = slopes(here);
  lack.stay_positive(at.information);
  for (int iteration = 0; iteration < most_steps; ++iteration) {
    Eigen::MatrixXd hessian = at.information + lack.matrix();
    std::vector<bool> held(static_cast<std::size_t>(at.score.size()), false);
    for (const Eigen::Index a : at.held) held[static_cast<std::size_t>(a)] = true;
    double gain = 0.0;
    Eigen::VectorXd taken;
    for (int failures = 0, dampings = 0;
         failures < most_failures && dampings < most_dampings && !(gain > 0.0);) {
      const std::optional<ScoringStep> next_step = damped_step(at, hessian, damping, held);
      if (!next_step) {
        damp_more();
        ++dampings;
        continue;
      }
      if (!(0.5 * next_step->slope > settled))
        return ended(iteration, "the next step promises next to nothing");
      taken = within(here, next_step->step);
      bool more_held = false;
      for (Eigen::Index a = 0; a < taken.size(); ++a)
        if (taken[a] == 0.0 && next_step->step[a] != 0.0)
          held[static_cast<std::size_t>(a)] = more_held = true;
      if (more_held) continue;
      Point next = moved(here, taken);
      gain = here.nll - next.nll;
      const double length = std::sqrt(next_step->slope);
      log.iteration(iteration + 1, std::min(here.nll, next.nll), gain > 0.0 ? length : 0.0, length,
                    {"lambda", damping});
      if (gain > 0.0) {
        const double predicted = at.score.dot(taken) - 0.5 * taken.dot(hessian * taken);
        if (gain > as_predicted * predicted) damping = damping > least_damping ? damping / more : 0.0;
        if (gain < far_from_predicted * predicted) damp_more();
        here = std::move(next);
      } else {
        if (std::isfinite(gain)) lack.learn_curvature(taken, at.score.dot(taken), gain, at.information);
        hessian = at.information + lack.matrix();
        if (++failures > 1 || !std::isfinite(gain)) damp_more();
      }
    }
    if (!(gain > settled))
      return ended(iteration + 1,
                   gain > 0.0 ? "the last step gained next to nothing" : "no damped step lowers the cost");
    ScoringSlopes next = slopes(here);
    lack.learn(taken, at.score - next.score, next.information);
    lack.stay_positive(next.information);
    at = std::move(next);
  }
  return ended(most_steps, "no iterations are left");
}

/// The same where nothing is known of C.
template <typename Point, typename SlopesAt, typename Within, typename Moved>
Point scored(const char* name, Point here, const SlopesAt& slopes, const Within& within, const Moved& moved,
             Eigen::Index parameters) {
  LackOfInformation lack(parameters);
  return scored(name, std::move(here), slopes, within, moved, lack);
}

}  // namespace rangecal::diagnosis
