// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/study/bound.hpp"

#include <Eigen/Cholesky>

#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/solvers/covariance/cramer_rao.hpp"

namespace rangecal {
namespace {

constexpr int hybrid_draws = 400;

StudyBound from_covariance(const Study& study, const Scene& scene, const Eigen::MatrixXd& covariance,
                           int landmarks) {
  const auto coefficients = static_cast<int>(scene.alpha.size());
  StudyBound bound;
  bound.landmarks_sq = covariance.diagonal().segment(coefficients, 2 * landmarks).sum();
  bound.curve_sq = variance_along(curve_rows(study.curve_m, coefficients), covariance).sum();
  return bound;
}

std::optional<StudyBound> pairs_bound(const Study& study, const StudyPoint& point) {
  const Scene& scene = point.scene;
  std::vector<double> d, y;
  for (const SceneBatch& batch : scene.batches)
    for (int i = 0; i < batch.readings; ++i) {
      d.push_back(batch.distance_m);
      y.push_back(batch.distance_m);
    }
  const PairsDerivatives at = pairs_derivatives(make_pairs_problem(d, y), scene.alpha, scene.noise);
  const Eigen::LDLT<Eigen::MatrixXd> ldlt(at.information);
  if (ldlt.info() != Eigen::Success || !ldlt.isPositive() || !(ldlt.rcond() > 1e-14)) return std::nullopt;
  return from_covariance(
      study, scene, ldlt.solve(Eigen::MatrixXd::Identity(at.information.rows(), at.information.cols())), 0);
}

}  // namespace

SceneTruth scene_truth(const Scene& scene, std::uint64_t seed) {
  const Recording first = simulate(scene, seed);
  SceneTruth truth{make_joint_problem({&first, 1}), {}};
  truth.state.alpha = scene.alpha;
  truth.state.noise = scene.noise;
  truth.state.sigma_theta_rad = scene.sigma_theta_rad;
  truth.state.landmarks = scene.positions;
  for (const StopPrior& prior : truth.problem.stops) truth.state.stops.push_back(prior.commanded);
  return truth;
}

Eigen::MatrixXd curve_rows(const std::vector<double>& at, int coefficients) {
  Eigen::MatrixXd rows(at.size(), coefficients);
  for (std::size_t i = 0; i < at.size(); ++i)
    for (int a = 0; a < coefficients; ++a) rows(i, a) = std::pow(at[i], a);
  return rows;
}

Eigen::VectorXd variance_along(const Eigen::MatrixXd& rows, const Eigen::MatrixXd& covariance) {
  return (rows * covariance.topLeftCorner(rows.cols(), rows.cols()) * rows.transpose()).diagonal();
}

std::optional<StudyBound> study_bound(const Study& study, const StudyPoint& point) {
  if (point.scene.kind == RecordingKind::pairs) return pairs_bound(study, point);
  if (point.scene.random_landmarks) return std::nullopt;
  const SceneTruth truth = scene_truth(point.scene, study_seed(study, point, 0, "bound"));
  if (truth.problem.landmark_count() != static_cast<int>(point.scene.positions.size())) return std::nullopt;
  const auto covariance = hybrid_cramer_rao_bound(truth.problem, truth.state, hybrid_draws, 1);
  if (!covariance) return std::nullopt;
  return from_covariance(study, point.scene, *covariance, truth.problem.landmark_count());
}

std::optional<StudyBound> placement_bound(const Study& study, const StudyPoint& point,
                                          const Recording& recording, const JointProblem& problem,
                                          const std::vector<int>& seen) {
  JointState state;
  state.alpha = point.scene.alpha;
  state.noise = point.scene.noise;
  state.sigma_theta_rad = point.scene.sigma_theta_rad;
  for (const int l : seen) state.landmarks.push_back(*recording.truth.landmarks[l]);
  for (const StopPrior& prior : problem.stops) state.stops.push_back(prior.commanded);
  const auto covariance = cramer_rao_bound(problem, state);
  if (!covariance) return std::nullopt;
  return from_covariance(study, point.scene, *covariance, problem.landmark_count());
}

}  // namespace rangecal
