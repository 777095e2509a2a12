// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/range_seed.hpp"

#include <Eigen/Dense>
#include <cmath>
#include <optional>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/closed_form/landmark_calibration.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_ranges.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"

namespace rangecal {
namespace {

using Eigen::Matrix2d;
using Eigen::Vector2d;

/// The line through the commanded stops that see a landmark.
struct PathLine {
  Vector2d centre = Vector2d::Zero(), across = Vector2d::Zero();
  Vector2d mirrored(const Vector2d& m) const { return m - 2.0 * across.dot(m - centre) * across; }
};

PathLine line_of(const JointProblem& problem, int landmark) {
  const Cells& c = problem.cells;
  std::vector<Vector2d> seen_from;
  PathLine line;
  for (std::size_t i = 0; i < c.size(); ++i) {
    if (c.landmark[i] != landmark) continue;
    const Pose2& commanded = problem.stops[static_cast<std::size_t>(c.stop[i])].commanded;
    seen_from.emplace_back(commanded.x_m, commanded.y_m);
    line.centre += seen_from.back();
  }
  line.centre /= static_cast<double>(seen_from.size());
  Matrix2d spread = Matrix2d::Zero();
  for (const Vector2d& stop : seen_from) spread += (stop - line.centre) * (stop - line.centre).transpose();
  line.across = Eigen::SelfAdjointEigenSolver<Matrix2d>(spread).eigenvectors().col(0);
  return line;
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

JointState range_seed(const JointProblem& problem, int order, NoiseLaw law) {
  constexpr double gains = 1e-3;  // nats
  constexpr int most_passes = 4;
  ClosedFormOptions options;
  options.order = order;
  options.noise_law = law;
  JointState seed = closed_form_state(problem, options);
  const LandmarksFromRanges found = landmarks_from_ranges(problem);
  std::vector<int> either_side;
  for (int l = 0; l < problem.landmark_count(); ++l)
    if (found.landmarks[static_cast<std::size_t>(l)].mirror_m) either_side.push_back(l);
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
      for (std::size_t k = 0; k < other.stops.size(); ++k) other.stops[k] = problem.stops[k].commanded;
      std::optional<JointFit> fit = solved_from(stated, std::move(other));
      if (!fit || !(fit->joint_nll < best->joint_nll - gains)) continue;
      best = std::move(fit);
      moved = true;
    }
  }
  seed.landmarks = best->state.landmarks;
  seed.stops = best->state.stops;
  seed_curve_and_noise(problem, order, seed);
  return seed;
}

}  // namespace rangecal
