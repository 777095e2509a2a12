// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/range_seed.hpp"

#include <cmath>
#include <optional>
#include <vector>

#include "closed_form/stops_line.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {
namespace {

using Eigen::Vector2d;

/// The line through the commanded stops that see a landmark.
StopsLine line_of(const JointProblem& problem, int landmark) {
  const Cells& c = problem.cells;
  std::vector<Vector2d> stops;
  for (std::size_t i = 0; i < c.size(); ++i) {
    const Pose2& commanded = problem.stops[static_cast<std::size_t>(c.stop[i])].commanded;
    if (c.landmark[i] == landmark) stops.emplace_back(commanded.x_m, commanded.y_m);
  }
  return StopsLine(stops);
}

/// The joint maximum from a start whose curve and noise are fitted anew; none where there is none.
std::optional<JointFit> solved_from(const JointProblem& problem, JointState start) {
  const int order = static_cast<int>(start.alpha.size()) - 1;
  try {
    seed_curve_and_noise(problem, order, start);
  } catch (const InputError&) {
    return std::nullopt;
  }
  JointFit fit = solve_joint_block(problem, start);
  if (!std::isfinite(fit.joint_nll) || !(fit.joint_nll <= fit.start_nll)) return std::nullopt;
  return fit;
}

}  // namespace

JointState range_seed(const JointProblem& problem, const ClosedFormOptions& options) {
  constexpr double gains = 1e-3;  // nats
  constexpr int most_passes = 4;
  std::vector<Vector2d> landmarks;
  std::vector<int> either_side;
  for (const LandmarkFromRanges& found : landmarks_from_ranges(problem).landmarks) {
    if (found.mirror_m) either_side.push_back(static_cast<int>(landmarks.size()));
    landmarks.push_back(found.position_m);
  }
  JointState seed = state_at_landmarks(problem, landmarks, options);
  if (either_side.empty()) return seed;
  JointProblem stated = problem;  // sigma_s as stated: where it is free the joint likelihood has no maximum
  stated.estimate_sigma_s = false;
  std::optional<JointFit> best = solved_from(stated, seed);
  if (!best) return seed;
  bool moved = true;
  for (int pass = 0; pass < most_passes && moved; ++pass) {
    moved = false;
    for (const int l : either_side) {
      JointState other = best->state;
      Vector2d& landmark = other.landmarks[static_cast<std::size_t>(l)];
      landmark = line_of(problem, l).mirrored(landmark);
      other.stops = seed.stops;  // as commanded
      std::optional<JointFit> fit = solved_from(stated, std::move(other));
      if (!fit || !(fit->joint_nll < best->joint_nll - gains)) continue;
      best = std::move(fit);
      moved = true;
    }
  }
  seed.landmarks = best->state.landmarks;
  seed.stops = best->state.stops;
  seed_curve_and_noise(problem, static_cast<int>(seed.alpha.size()) - 1, seed);
  return seed;
}

}  // namespace rangecal
