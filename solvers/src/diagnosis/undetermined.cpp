// SPDX-License-Identifier: BSD-3-Clause
#include "diagnosis/undetermined.hpp"

#include <algorithm>

#include "calibrate/landmarks_job.hpp"
#include "calibrate/observability.hpp"
#include "diagnosis/report.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/pairs_ml/pairs_ml.hpp"

namespace rangecal::diagnosis {
namespace {

/// A constant as the line of slope 1 through it at the middle of the distances: whether they tell a slope is
/// the question.
JointState with_a_slope(const Rows& rows, JointState state) {
  if (state.alpha.size() > 1) return state;
  const std::vector<double> d = cell_geometry(rows, state).d;
  const auto [low, high] = std::minmax_element(d.begin(), d.end());
  const double constant = state.alpha[0];
  state.alpha = Eigen::Vector2d(constant - 0.5 * (*low + *high), 1.0);
  return state;
}

std::optional<Undetermined> undetermined_pairs(std::span<const Recording> recordings, const Fit& fit) {
  PairsOptions options;
  options.order = std::max(1, static_cast<int>(fit.state.alpha.size()) - 1);
  options.law = fit.state.noise.law;
  const Calibration c = marginal_pairs(make_pairs_problem(recordings), options).calibration;
  if (c.outcome != Outcome::unobservable || c.alpha_covariance) return std::nullopt;
  return Undetermined{c.reason, c.weakest_direction};
}

}  // namespace

std::optional<Undetermined> undetermined(const Rows& rows, std::span<const Recording> recordings,
                                         const Fit& fit) {
  if (rows.pairs) return undetermined_pairs(recordings, fit);
  const std::vector<std::string> labels = landmark_labels(recordings);
  const std::string direction = in_user_words(fit.weakest_direction, labels, fit.state.noise.law);
  if (const auto what = unobservable_reason(rows.problem, with_a_slope(rows, fit.state)))
    return Undetermined{*what, fit.state.alpha.size() > 1 ? direction : std::string()};
  if (fit.outcome != Outcome::unobservable || fit.alpha_covariance.size() > 0) return std::nullopt;
  return Undetermined{in_user_words(fit.reason, labels, fit.state.noise.law), direction};
}

void mark_undetermined(const Rows& rows, const Undetermined& open, const Fit& fit, Calibration& calibration) {
  calibration.weakest_direction = open.weakest_direction;
  mark_unobservable(rows.problem, open.what, fit.state, calibration);
}

}  // namespace rangecal::diagnosis
