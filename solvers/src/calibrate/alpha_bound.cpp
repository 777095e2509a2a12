// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate/alpha_bound.hpp"

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "calibrate/scale_choice.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/core/seen_landmarks.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"

namespace rangecal {
namespace {

/// Of the first `count` unknowns; none where the bound is singular.
std::optional<Eigen::VectorXd> alpha_deviations(const std::optional<Eigen::MatrixXd>& bound,
                                                Eigen::Index count) {
  if (!bound || !(bound->diagonal().head(count).array() >= 0.0).all()) return std::nullopt;
  return Eigen::VectorXd(bound->diagonal().head(count).cwiseSqrt());
}

/// The state at the true stops and landmarks; none where one that the problem has has no true place.
std::optional<JointState> at_true_places(std::span<const Recording> recordings, JointState state) {
  std::size_t k = 0, l = 0;
  for (const Recording& recording : recordings) {
    const Truth& truth = recording.truth;
    if (truth.stops.size() != recording.stops.size() || truth.landmarks.size() != recording.landmarks.size())
      return std::nullopt;
    for (const std::optional<Pose2>& pose : truth.stops) {
      if (!pose) return std::nullopt;
      state.stops[k++] = *pose;
    }
    for (const std::optional<Eigen::Vector2d>& position : truth.landmarks) {
      if (!position) return std::nullopt;
      state.landmarks[l++] = *position;
    }
  }
  return state;
}

/// The calibration as a state of the problem of its own recordings.
std::optional<JointState> state_of(const Calibration& c, const JointProblem& problem) {
  if ((problem.reads_bearings && !c.sigma_theta_rad) ||
      static_cast<int>(c.landmarks.size()) != problem.landmark_count())
    return std::nullopt;
  JointState state;
  state.alpha = c.alpha;
  state.noise = c.noise;
  state.sigma_theta_rad = problem.reads_bearings ? c.sigma_theta_rad->value : SilentBearing::sigma_theta_rad;
  if (problem.estimate_sigma_s) {
    if (!c.sigma_s_m) return std::nullopt;
    state.sigma_s_m = std::max(c.sigma_s_m->value, no_sigma_s(problem));
  }
  for (const LandmarkEstimate& landmark : c.landmarks) state.landmarks.push_back(landmark.position_m);
  const bool own = c.stops.size() == problem.stops.size();
  for (std::size_t k = 0; k < problem.stops.size(); ++k)
    state.stops.push_back(own ? c.stops[k].pose : problem.stops[k].commanded);
  return state;
}

}  // namespace

std::optional<AlphaBound> alpha_bound(std::span<const Recording> recordings, const Calibration& calibration) {
  const Eigen::Index count = calibration.alpha.size();
  if (recordings.empty() || recordings[0].kind != calibration.kind || count == 0 ||
      !calibration.alpha.allFinite() || !calibration.noise.parameters.allFinite() ||
      !calibration.effects.empty() || !calibration.noise_shapes.empty())
    return std::nullopt;
  AlphaBound bound;
  if (calibration.kind == RecordingKind::pairs) {
    std::vector<Recording> scaled;  // given the scale
    if (!calibration.scale.is_distance())
      for (const Recording& recording : recordings) scaled.push_back(on_scale(recording, calibration.scale));
    const PairsDerivatives at = pairs_derivatives(make_pairs_problem(scaled.empty() ? recordings : scaled),
                                                  calibration.alpha, calibration.noise);
    if (!std::isfinite(at.nll)) return std::nullopt;
    const auto std_dev = alpha_deviations(scaled_inverse(at.information), count);
    if (!std_dev) return std::nullopt;
    bound.at_estimate = *std_dev;
    return bound;
  }
  const std::vector<Recording> seen = with_seen_landmarks(recordings);
  const JointProblem problem = make_joint_problem(seen);
  const std::optional<JointState> state = state_of(calibration, problem);
  if (!state) return std::nullopt;
  const auto std_dev = alpha_deviations(cramer_rao_bound(problem, *state), count);
  if (!std_dev) return std::nullopt;
  bound.at_estimate = *std_dev;
  if (const auto truth = at_true_places(seen, *state))
    bound.at_truth = alpha_deviations(cramer_rao_bound(problem, *truth), count);
  return bound;
}

void set_alpha_bounds(std::span<const Recording> recordings, std::span<Calibration> calibrations) {
  for (Calibration& c : calibrations) {
    c.bound_alpha_std.reset();
    const bool answers =
        c.outcome == Outcome::converged || (c.outcome == Outcome::unobservable && c.alpha_covariance);
    if (!answers) continue;
    if (auto bound = alpha_bound(recordings, c)) c.bound_alpha_std = std::move(bound->at_estimate);
  }
}

}  // namespace rangecal
