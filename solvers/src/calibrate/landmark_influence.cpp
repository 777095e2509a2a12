// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/landmark_influence.hpp"

#include <algorithm>
#include <map>
#include <set>

#include "calibrate/marginal_score.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

constexpr int most_landmark_groups = 50, fewest_landmarks = 4;

/// The landmarks that some stop reads, those of one label together.
std::vector<std::vector<int>> seen_by_label(const JointProblem& problem,
                                            const std::vector<std::string>& labels) {
  const std::set<int> seen(problem.cells.landmark.begin(), problem.cells.landmark.end());
  std::map<std::string, std::size_t> index;
  std::vector<std::vector<int>> by_label;
  for (const int l : seen) {
    const auto [found, is_new] = index.emplace(labels[static_cast<std::size_t>(l)], by_label.size());
    if (is_new) by_label.emplace_back();
    by_label[found->second].push_back(l);
  }
  return by_label;
}

/// Places from which something is read: stops that share one share its error.
int reading_places(const JointProblem& problem) {
  std::set<int> places;
  for (const int k : problem.cells.stop) places.insert(problem.stops[k].place);
  return static_cast<int>(places.size());
}

/// The globals that were estimated, but for the places of landmarks left out (one flag each).
std::vector<int> free_without(const Eigen::MatrixXd& covariance, const JointLayout& layout,
                              const std::vector<char>& left_out) {
  std::vector<int> free;
  for (int j = 0; j < covariance.rows(); ++j) {
    const bool of_landmark = j >= layout.landmark_begin && j < layout.phi_count;
    if (covariance(j, j) > 0.0 && !(of_landmark && left_out[(j - layout.landmark_begin) / 2]))
      free.push_back(j);
  }
  return free;
}

/// C B^T H_ss^-1 P H_ss^-1 B C, of alpha.
Eigen::MatrixXd share_of_poses(const JointProblem& problem, const JointState& state,
                               const Eigen::MatrixXd& covariance, bool sigma_s_free) {
  const int alphas = static_cast<int>(state.alpha.size()),
            taus = static_cast<int>(state.noise.parameters.size());
  JointSystem system(problem, alphas, taus, sigma_s_free);
  system.assemble(state, HessianKind::exact);
  system.eliminate();
  const int coordinates = system.layout().coordinates;
  Eigen::MatrixXd moves(alphas, coordinates);  // of alpha, by a unit of the score of each coordinate
  for (int a = 0; a < alphas; ++a) moves.row(a) = -system.back_substitute(covariance.col(a), false);
  const JointProblem unread =
      without_landmarks(problem, std::vector<char>(problem.landmark_radius_m.size(), 1));
  JointSystem poses(unread, alphas, taus, sigma_s_free);
  poses.assemble(state, HessianKind::exact);
  return moves * poses.dense_hessian().bottomRightCorner(coordinates, coordinates) * moves.transpose();
}

}  // namespace

std::optional<LandmarkInfluence> landmark_influence(const JointProblem& problem,
                                                    const std::vector<std::string>& labels,
                                                    const JointState& state,
                                                    const Eigen::MatrixXd& covariance) {
  const std::vector<std::vector<int>> seen = seen_by_label(problem, labels);
  const int count = static_cast<int>(seen.size());
  if (count < fewest_landmarks || count <= reading_places(problem)) return std::nullopt;
  const int alphas = static_cast<int>(state.alpha.size());
  const JointLayout plain(problem, alphas, static_cast<int>(state.noise.parameters.size()), false);
  const bool sigma_s_free = covariance.rows() > plain.global_count;
  const std::optional<MarginalScore> whole = marginal_score(problem, state, sigma_s_free, true);
  if (!whole) return std::nullopt;
  const Eigen::MatrixXd C_H = covariance.topRows(alphas) * whole->hessian;

  LandmarkInfluence result;
  result.groups = std::min(count, most_landmark_groups);
  Eigen::MatrixXd steps(alphas, result.groups);
  for (int i = 0; i < result.groups; ++i) {
    std::vector<char> left_out(problem.landmark_radius_m.size(), 0);
    for (int l = 0; l < count; ++l)
      if (l * result.groups / count == i)
        for (const int landmark : seen[static_cast<std::size_t>(l)]) left_out[landmark] = 1;
    const std::vector<int> free = free_without(covariance, plain, left_out);
    if (static_cast<int>(free.size()) < alphas || free[alphas - 1] != alphas - 1) return std::nullopt;
    const auto score = marginal_score(without_landmarks(problem, left_out), state, sigma_s_free, false);
    if (!score) return std::nullopt;
    const auto inverse = scaled_inverse(score->hessian(free, free));
    if (!inverse) return std::nullopt;
    const Eigen::MatrixXd C_i = C_H(Eigen::all, free) * *inverse;  // C H H_(i)^-1
    steps.col(i) = -C_i * score->gradient(free);
    const Eigen::MatrixXd of_alpha = C_i.leftCols(alphas);
    result.expected.push_back(0.5 * (of_alpha + of_alpha.transpose()) -
                              covariance.topLeftCorner(alphas, alphas));
  }
  const double G = result.groups;
  steps.colwise() -= steps.rowwise().mean().eval();
  result.per_group = (G - 1.0) / G;
  result.jackknife = result.per_group * steps * steps.transpose();
  result.of_poses = share_of_poses(problem, state, covariance, sigma_s_free);
  return result;
}

}  // namespace rangecal
