// SPDX-License-Identifier: BSD-3-Clause
#include "calibrate/stop_influence.hpp"

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <utility>

#include "calibrate/walk_seed.hpp"
#include "marginal/laplace.hpp"
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

/// The problem of some stops alone, those of a place together, with all landmarks; measured distances between landmarks belong to
/// no group.
JointProblem part_of(const JointProblem& problem, const std::vector<int>& stops) {
  JointProblem part;
  part.landmark_radius_m = problem.landmark_radius_m;
  part.landmark_recording = problem.landmark_recording;
  part.estimate_sigma_s = problem.estimate_sigma_s;
  const Cells& all = problem.cells;
  Cells& c = part.cells;
  c.stop_begin.push_back(0);
  int last_place = -1;
  for (const int k : stops) {
    StopPrior prior = problem.stops[k];
    if (prior.place != std::exchange(last_place, prior.place)) ++part.place_count;
    prior.place = part.place_count - 1;
    part.stops.push_back(prior);
    part.sigma_s_shared.push_back(problem.sigma_s_shared[k]);
    for (int i = all.stop_begin[k]; i < all.stop_begin[k + 1]; ++i) {
      c.stop.push_back(static_cast<int>(part.stops.size()) - 1);
      c.landmark.push_back(all.landmark[i]);
      c.count.push_back(all.count[i]);
      c.range_weight.push_back(all.range_weight[i]);
      c.bearing_weight.push_back(all.bearing_weight[i]);
      c.range_mean.push_back(all.range_mean[i]);
      c.range_mean_square.push_back(all.range_mean_square[i]);
      c.bearing_mean.push_back(all.bearing_mean[i]);
      c.bearing_mean_square.push_back(all.bearing_mean_square[i]);
      c.radius_m.push_back(all.radius_m[i]);
      part.readings += all.count[i];
    }
    c.stop_begin.push_back(static_cast<int>(c.size()));
  }
  return part;
}

/// Gradient and Hessian of the marginal NLL in the globals.
struct Score {
  Eigen::VectorXd gradient;
  Eigen::MatrixXd hessian;
};

/// The stops move to their conditional optimum first, where they are not there already.
std::optional<Score> score_of(const JointProblem& problem, JointState state, bool sigma_s_free,
                              bool settled = true) {
  JointSystem system(problem, static_cast<int>(state.alpha.size()),
                     static_cast<int>(state.noise.parameters.size()), sigma_s_free);
  int evaluations = 0;
  if (!settled && !std::isfinite(settle_stops(system, state, evaluations))) return std::nullopt;
  if (settled && (!std::isfinite(system.assemble(state, HessianKind::exact)) || !system.eliminate()))
    return std::nullopt;
  Score score{system.reduced_gradient() + system.log_det_gradient(state), system.schur()};
  const int sigmas = system.layout().sigma_count();
  score.hessian.bottomRightCorner(sigmas, sigmas) += system.log_det_sigma_hessian(state);
  return score;
}

/// The scores of the groups, which add up to that of all stops: each group's alone, or along a random walk what it adds to the
/// groups before it.
std::optional<std::vector<Score>> scores_of(const JointProblem& problem, const JointState& state,
                                            bool sigma_s_free, const std::vector<std::vector<int>>& groups) {
  const bool walk = is_walk(problem);
  std::vector<Score> scores;
  std::optional<Score> before;
  std::vector<int> stops;
  for (const std::vector<int>& group : groups) {
    if (!walk) stops.clear();
    stops.insert(stops.end(), group.begin(), group.end());
    JointState part = state;
    part.stops.clear();
    for (const int k : stops) part.stops.push_back(state.stops[k]);
    const std::optional<Score> score = score_of(part_of(problem, stops), part, sigma_s_free, !walk);
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
void compare_halves(const std::vector<Score>& scores, const Eigen::VectorXd& mean,
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
  StopInfluence result;
  result.stops = groups_of(problem);
  if (result.groups() < fewest_groups) return std::nullopt;
  const int alphas = static_cast<int>(state.alpha.size());
  const JointLayout plain(problem, alphas, static_cast<int>(state.noise.parameters.size()), false);
  const bool sigma_s_free = covariance.rows() > plain.global_count;
  const std::optional<Score> whole = score_of(problem, state, sigma_s_free);
  if (!whole) return std::nullopt;
  std::vector<int> free;
  for (Eigen::Index i = 0; i < covariance.rows(); ++i)
    if (covariance(i, i) > 0.0) free.push_back(static_cast<int>(i));
  const Eigen::Index size = static_cast<Eigen::Index>(free.size());
  const Eigen::LLT<Eigen::MatrixXd> factor(whole->hessian(free, free));
  if (size == 0 || factor.info() != Eigen::Success) return std::nullopt;
  const Eigen::MatrixXd inverse = factor.solve(Eigen::MatrixXd::Identity(size, size)),
                        C = covariance(free, free);

  std::optional<std::vector<Score>> scores = scores_of(problem, state, sigma_s_free, result.stops);
  if (!scores) return std::nullopt;
  const double all = result.groups();
  for (std::size_t k = scores->size(); k-- > 0;)
    if (holds_a_beginning(problem, result.stops[k])) {
      result.stops.erase(result.stops.begin() + static_cast<std::ptrdiff_t>(k));
      scores->erase(scores->begin() + static_cast<std::ptrdiff_t>(k));
    }
  if (result.groups() < fewest_groups) return std::nullopt;
  Eigen::VectorXd mean = Eigen::VectorXd::Zero(size);
  for (Score& score : *scores) {
    score = {score.gradient(free).eval(), score.hessian(free, free).eval()};
    mean += score.gradient / result.groups();
  }
  Eigen::MatrixXd steps(size, result.groups());
  for (int k = 0; k < result.groups(); ++k) {
    const Score& score = (*scores)[static_cast<std::size_t>(k)];
    const Eigen::MatrixXd kept = Eigen::MatrixXd::Identity(size, size) - score.hessian * inverse;
    const Eigen::PartialPivLU<Eigen::MatrixXd> left(kept);
    if (!(left.rcond() > 1e-10)) return std::nullopt;
    steps.col(k) = C * left.solve(score.gradient - mean);
    Eigen::VectorXd whole_step = Eigen::VectorXd::Zero(covariance.rows());
    whole_step(free) = steps.col(k);
    result.left_out.push_back(whole_step);
  }
  const double K = result.groups();
  steps.colwise() -= steps.rowwise().mean().eval();
  result.covariance = Eigen::MatrixXd::Zero(covariance.rows(), covariance.rows());
  result.covariance(free, free) = all / K * (K - 1.0) / K * steps * steps.transpose();
  if (!is_walk(problem) && free.front() == 0 && size > alphas && free[alphas - 1] == alphas - 1)
    compare_halves(*scores, mean, inverse, C, alphas, result);
  return result;
}

}  // namespace rangecal
