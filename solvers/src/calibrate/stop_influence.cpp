// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/stop_influence.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>

#include "calibrate/marginal_score.hpp"
#include "calibrate/walk_seed.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

constexpr int most_groups = 500, most_stretches = 20, fewest_groups = 4;

/// The stops of consecutive places; those that read nothing belong to a walk alone.
std::vector<std::vector<int>> groups_of(const JointProblem& problem) {
  const bool walk = is_walk(problem);
  std::vector<std::vector<int>> by_place(problem.place_count);
  for (int k = 0; k < problem.stop_count(); ++k)
    if (walk || problem.cells.stop_begin[k + 1] > problem.cells.stop_begin[k])
      by_place[problem.stops[k].place].push_back(k);
  std::erase_if(by_place, [](const std::vector<int>& stops) { return stops.empty(); });
  const std::size_t places = by_place.size(),
                    count = std::min<std::size_t>(places, walk ? most_stretches : most_groups);
  std::vector<std::vector<int>> groups(count);
  for (std::size_t p = 0; p < places; ++p) {
    std::vector<int>& group = groups[p * count / places];
    group.insert(group.end(), by_place[p].begin(), by_place[p].end());
  }
  return groups;
}

/// Whether a walk begins at one of the stops: they alone tie the landmarks to the frame.
bool holds_a_beginning(const JointProblem& problem, const std::vector<int>& stops) {
  return std::any_of(stops.begin(), stops.end(), [&](int k) {
    return !problem.stops[k].chained && k + 1 < problem.stop_count() && problem.stops[k + 1].chained;
  });
}

/// The scores of the groups, which add up to that of all stops: each group's alone, or along a random walk what it adds to the
/// groups before it.
std::optional<std::vector<MarginalScore>> scores_of(const JointProblem& problem, const JointState& state,
                                                    bool sigma_s_free,
                                                    const std::vector<std::vector<int>>& groups) {
  const bool walk = is_walk(problem);
  std::vector<MarginalScore> scores;
  std::optional<MarginalScore> before;
  std::vector<int> stops;
  for (const std::vector<int>& group : groups) {
    if (!walk) stops.clear();
    stops.insert(stops.end(), group.begin(), group.end());
    JointState part = state;
    part.stops.clear();
    for (const int k : stops) part.stops.push_back(state.stops[k]);
    const std::optional<MarginalScore> score =
        marginal_score(part_of(problem, stops), part, sigma_s_free, !walk);
    if (!score) return std::nullopt;
    scores.push_back(*score);
    if (before) {
      scores.back().gradient -= before->gradient;
      scores.back().hessian -= before->hessian;
    }
    if (walk) before = score;
  }
  return scores;
}

/// The difference between the alphas of the two halves, by one Newton step each.
void compare_halves(const std::vector<MarginalScore>& scores, const Eigen::VectorXd& mean,
                    const Eigen::MatrixXd& inverse, const Eigen::MatrixXd& covariance, Eigen::Index alphas,
                    StopInfluence& result) {
  const Eigen::Index size = mean.size();
  std::vector<Eigen::VectorXd> ends;
  Eigen::MatrixXd sum = Eigen::MatrixXd::Zero(alphas, alphas);
  // Factor by which the stated covariance differs from the inverse Hessian, because of the noise shape.
  const double stated =
      covariance.topLeftCorner(alphas, alphas).trace() / inverse.topLeftCorner(alphas, alphas).trace();
  for (const bool second : {false, true}) {
    Eigen::VectorXd g = Eigen::VectorXd::Zero(size);
    Eigen::MatrixXd H = Eigen::MatrixXd::Zero(size, size);
    const std::size_t half = scores.size() / 2;
    for (std::size_t k = second ? half : 0; k < (second ? scores.size() : half); ++k) {
      g += scores[k].gradient - mean;
      H += scores[k].hessian;
    }
    const Eigen::LLT<Eigen::MatrixXd> factor(H);
    if (factor.info() != Eigen::Success || factor.rcond() < 1e-14) return;
    ends.push_back(-factor.solve(g));
    sum += stated * factor.solve(Eigen::MatrixXd::Identity(size, size)).topLeftCorner(alphas, alphas);
  }
  result.halves_difference = (ends[0] - ends[1]).head(alphas);
  result.halves_covariance = sum;
}

}  // namespace

std::optional<StopInfluence> stop_influence(const JointProblem& problem, const JointState& state,
                                            const Eigen::MatrixXd& covariance) {
  const bool walk = is_walk(problem);
  StopInfluence result;
  result.stops = groups_of(problem);
  if (result.groups() < fewest_groups) return std::nullopt;
  const int alphas = static_cast<int>(state.alpha.size());
  const JointLayout plain(problem, alphas, static_cast<int>(state.noise.parameters.size()), false);
  const bool sigma_s_free = covariance.rows() > plain.global_count;
  const std::optional<MarginalScore> whole = marginal_score(problem, state, sigma_s_free, true);
  if (!whole) return std::nullopt;
  std::vector<int> free;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i)
    if (covariance(i, i) > 0.0) free.push_back(static_cast<int>(i));
  const Eigen::Index size = static_cast<Eigen::Index>(free.size());
  const Eigen::LLT<Eigen::MatrixXd> factor(whole->hessian(free, free));
  if (size == 0 || factor.info() != Eigen::Success) return std::nullopt;
  const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(size, size)),
                        C = covariance(free, free);

  std::optional<std::vector<MarginalScore>> scores = scores_of(problem, state, sigma_s_free, result.stops);
  if (!scores) return std::nullopt;
  const double all = result.groups();
  for (std::size_t k = scores->size(); k-- > 0;)
    if (holds_a_beginning(problem, result.stops[k])) {
      result.stops.erase(result.stops.begin() + static_cast<std::ptrdiff_t>(k));
      scores->erase(scores->begin() + static_cast<std::ptrdiff_t>(k));
    }
  if (result.groups() < fewest_groups) return std::nullopt;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(size);
  for (MarginalScore& score : *scores) {
    score = {score.gradient(free).eval(), score.hessian(free, free).eval()};
    mean += score.gradient / result.groups();
  }
  const int places = plain.landmark_begin, L = problem.landmark_count();
  Eigen::VectorXd per_place = Eigen::VectorXd::Zero(2 * L);  // root of A
  for (int l = 0; l < L; ++l)
    if (const double stated = covariance.block<2, 2>(places + 2 * l, places + 2 * l).trace(); stated > 0.0)
      per_place.segment<2>(2 * l).setConstant(1.0 / std::sqrt(L * stated));
  Eigen::MatrixXd steps(size, result.groups());
  for (int k = 0; k < result.groups(); ++k) {
    const MarginalScore& score = (*scores)[static_cast<std::size_t>(k)];
    const Eigen::MatrixXd share = score.hessian * inverse,
                          kept = Eigen::MatrixXd::Identity(size, size) - share;
    const Eigen::PartialPivLU<Eigen::MatrixXd> left(kept);
    if (!(left.rcond() > 1e-10)) return std::nullopt;
    steps.col(k) = C * left.solve(score.gradient - mean);
    Eigen::VectorXd whole_step = Eigen::VectorXd::Zero(covariance.rows());
    whole_step(free) = steps.col(k);
    result.left_out.push_back(whole_step);
    if (walk) continue;
    Eigen::MatrixXd expected = Eigen::MatrixXd::Zero(covariance.rows(), covariance.rows());
    expected(free, free) = C * left.solve(share);
    result.expected.push_back(expected.topLeftCorner(alphas, alphas));
    const Eigen::MatrixXd of_places = per_place.asDiagonal() *
                                      expected.block(places, places, per_place.size(), per_place.size()) *
                                      per_place.asDiagonal();
    result.expected_of_places.push_back(of_places.trace());
    result.squares_of_places.push_back(of_places.squaredNorm());
  }
  const double K = result.groups();
  steps.colwise() -= steps.rowwise().mean().eval();
  result.covariance = Eigen::MatrixXd::Zero(covariance.rows(), covariance.rows());
  result.per_group = all / K * (K - 1.0) / K;
  result.covariance(free, free) = result.per_group * steps * steps.transpose();
  if (!walk && free.front() == 0 && size > alphas && free[alphas - 1] == alphas - 1)
    compare_halves(*scores, mean, inverse, C, alphas, result);
  return result;
}

}  // namespace rangecal
