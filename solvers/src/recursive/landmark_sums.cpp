// SPDX-License-Identifier: BSD-3-Clause
#include "recursive/landmark_sums.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "marginal/laplace.hpp"

namespace rangecal {
namespace {

using Eigen::MatrixXd;
using Eigen::Vector2d;
using Eigen::VectorXd;

double chebyshev_node(int i) { return std::cos((i + 0.5) * std::numbers::pi / SigmaGrid::side); }

std::array<double, SigmaGrid::side> lagrange(double u) {
  std::array<double, SigmaGrid::side> weight;
  for (int i = 0; i < SigmaGrid::side; ++i) {
    weight[i] = 1.0;
    for (int j = 0; j < SigmaGrid::side; ++j)
      if (j != i) weight[i] *= (u - chebyshev_node(j)) / (chebyshev_node(i) - chebyshev_node(j));
  }
  return weight;
}

/// What differences along the stops' optima tell: the second derivatives in phi of 1/2 log det H_ss and the
/// third of the rest of l_s, the latter where it is wanted.
struct Curvature {
  MatrixXd beyond;
  std::vector<MatrixXd> third;
  /// With a law of the first stop: what the mean of that moving along adds to the slope of 1/2 log det H_ss.
  /// Like its part of `beyond`, which is left out, it is one stop's of a block: taken at one place of the
  /// sigmas.
  VectorXd slope;
  std::vector<MatrixXd> law_bend, law_turn;  ///< of a random walk: D and E of the law of its last stop
};

/// Leaves the stops of `at` at their optimum. `start`: of `problem`, or null.
Curvature curvature_of(const JointProblem& problem, JointState& at, WalkStart* start, const SigmaGrid& grid) {
  const int alphas = static_cast<int>(at.alpha.size());
  JointSystem system(problem, alphas, 1);
  int evaluations = 0;
  const Eigen::Index phis = system.layout().phi_count;
  Curvature none{MatrixXd::Zero(phis, phis), {}, VectorXd::Zero(phis), {}, {}};
  const VectorXd weights = grid.weights(log_sigmas_of(at));
  if (start && !start->set(weights, phi_of(at))) return none;
  const bool third = phis <= LandmarkSums::most_cubed;
  if (third) none.third.assign(static_cast<std::size_t>(phis), MatrixXd::Zero(phis, phis));
  if (!std::isfinite(settle_stops(system, at, evaluations))) return none;
  Curvature result = none;
  if (system.layout().chained) {
    const LastPose law = law_of_last(system, at, start);
    result.law_bend.assign(static_cast<std::size_t>(phis), 0.0 * law.covariance[0]);
    result.law_turn.assign(static_cast<std::size_t>(phis), 0.0 * law.slope[0]);
  }
  if (start)
    result.slope = -system.log_det_gradient(at).head(phis) - start->share(system, at).log_det_gradient;
  std::vector<char> seen(static_cast<std::size_t>(phis), 0);
  std::fill(seen.begin(), seen.begin() + alphas, 1);
  for (const int l : problem.cells.landmark)
    seen[static_cast<std::size_t>(alphas + 2 * l)] = seen[static_cast<std::size_t>(alphas + 2 * l + 1)] = 1;
  const double scale = mean_range(problem);
  const auto step_of = [&](Eigen::Index i) {
    return 1e-3 * (i < alphas ? std::pow(scale, 1.0 - static_cast<double>(i)) : scale);
  };
  std::vector<JointState> moved;
  for (Eigen::Index i = 0; i < phis; ++i) {
    if (!seen[static_cast<std::size_t>(i)]) continue;
    for (const double side : {1.0, -1.0}) {
      VectorXd globals = VectorXd::Zero(system.layout().global_count);
      globals[i] = side * step_of(i);
      moved.push_back(
          step_state(problem, system.layout(), at, globals, system.back_substitute(globals, false)));
    }
  }
  auto next = moved.begin();
  for (Eigen::Index i = 0; i < phis; ++i) {
    if (!seen[static_cast<std::size_t>(i)]) continue;
    for (const double side : {1.0, -1.0}) {
      if (start && !start->set(weights, phi_of(*next))) return none;
      if (!std::isfinite(settle_stops(system, *next, evaluations))) return none;
      const double share = side / (2.0 * step_of(i));
      result.beyond.col(i) += share * system.log_det_gradient(*next).head(phis);
      if (start) result.slope[i] += share * 0.5 * system.log_det_stops();
      if (system.layout().chained) {
        const LastPose law = law_of_last(system, *next, start);
        result.law_bend[static_cast<std::size_t>(i)] += share * law.covariance[0];
        result.law_turn[static_cast<std::size_t>(i)] += share * law.slope[0];
      }
      if (third) {
        MatrixXd& along_i = result.third[static_cast<std::size_t>(i)];
        along_i += share * system.schur().topLeftCorner(phis, phis);
        if (start) along_i += share * start->share(system, *next).schur;
      }
      ++next;
    }
  }
  result.beyond = (0.5 * (result.beyond + result.beyond.transpose())).eval();
  return result;
}

}  // namespace

MatrixXd along(const std::vector<MatrixXd>& third, const VectorXd& delta) {
  MatrixXd sum = MatrixXd::Zero(delta.size(), delta.size());
  for (std::size_t i = 0; i < third.size(); ++i) sum += delta[static_cast<Eigen::Index>(i)] * third[i];
  return sum;
}

Vector2d SigmaGrid::node(int q) const {
  return centre + half_width * Vector2d(chebyshev_node(q % side), chebyshev_node(q / side));
}

VectorXd SigmaGrid::weights(const Vector2d& log_sigmas) const {
  const Vector2d u = (log_sigmas - centre) / half_width;
  const auto first = lagrange(u.x()), second = lagrange(u.y());
  VectorXd weight(nodes);
  for (int q = 0; q < nodes; ++q)
    weight[q] = first[static_cast<std::size_t>(q % side)] * second[static_cast<std::size_t>(q / side)];
  return weight;
}

void LandmarkSums::grow(const VectorXd& whole_reference) {
  const Eigen::Index before = reference.size(), size = whole_reference.size();
  if (before == size) return;
  const VectorXd kept = reference;
  reference = whole_reference;
  reference.head(before) = kept;
  for (VectorXd& g : gradient) {
    g.conservativeResize(size);
    g.tail(size - before).setZero();
  }
  const auto larger = [&](MatrixXd& matrix) {
    MatrixXd whole = MatrixXd::Zero(size, size);
    whole.topLeftCorner(before, before) = matrix;
    matrix = whole;
  };
  for (MatrixXd& h : hessian) larger(h);
  larger(beyond);
  if (last_pose) last_pose->grow(size);
  for (MatrixXd& t : third) larger(t);
  if (size > most_cubed)
    third.clear();
  else if (!third.empty())
    third.resize(static_cast<std::size_t>(size), MatrixXd::Zero(size, size));
}

void LandmarkSums::add(const LandmarkSums& other) {
  value += other.value;
  for (std::size_t q = 0; q < gradient.size(); ++q) {
    gradient[q] += other.gradient[q];
    hessian[q] += other.hessian[q];
  }
  beyond += other.beyond;
  for (std::size_t i = 0; i < third.size(); ++i) third[i] += other.third[i];
  last_pose = other.last_pose;
}

void LandmarkSums::scale(double factor) {
  value *= factor;
  for (VectorXd& g : gradient) g *= factor;
  for (MatrixXd& h : hessian) h *= factor;
  beyond *= factor;
  for (MatrixXd& t : third) t *= factor;
}

void LandmarkSums::follow(const Vector2d& log_sigmas) {
  const Vector2d from_centre = log_sigmas - grid.centre;
  if (from_centre.lpNorm<Eigen::Infinity>() < 0.5 * grid.half_width) return;
  LandmarkSums moved = *this;
  moved.grid.centre += from_centre.cwiseMax(-0.5 * grid.half_width).cwiseMin(0.5 * grid.half_width);
  for (int q = 0; q < SigmaGrid::nodes; ++q) {
    At there = at(moved.grid.node(q));
    moved.value[q] = there.value;
    moved.gradient[static_cast<std::size_t>(q)] = std::move(there.gradient);
    moved.hessian[static_cast<std::size_t>(q)] = std::move(there.hessian);
    if (!last_pose) continue;
    LastPose law = last_pose->at(grid.weights(moved.grid.node(q)));
    moved.last_pose->mean[static_cast<std::size_t>(q)] = std::move(law.mean[0]);
    moved.last_pose->slope[static_cast<std::size_t>(q)] = std::move(law.slope[0]);
    moved.last_pose->covariance[static_cast<std::size_t>(q)] = std::move(law.covariance[0]);
  }
  *this = std::move(moved);
}

LandmarkSums::At LandmarkSums::at(const Vector2d& log_sigmas) const {
  const VectorXd weight = grid.weights(log_sigmas);
  At result{weight.dot(value), VectorXd::Zero(reference.size()),
            MatrixXd::Zero(reference.size(), reference.size())};
  for (Eigen::Index q = 0; q < SigmaGrid::nodes; ++q) {
    result.gradient += weight[q] * gradient[static_cast<std::size_t>(q)];
    result.hessian += weight[q] * hessian[static_cast<std::size_t>(q)];
  }
  return result;
}

std::optional<LandmarkSums> expand_stops(const JointProblem& problem, JointState& state,
                                         const SigmaGrid& grid, const VectorXd& reference,
                                         const LastPose* first) {
  LandmarkSums sums;
  sums.grid = grid;
  sums.reference = reference;
  sums.value.resize(SigmaGrid::nodes);
  const VectorXd phi = phi_of(state), offset = reference - phi;
  JointProblem with_law;
  std::optional<WalkStart> start;
  if (first) {
    with_law = problem;
    start.emplace(with_law, *first, reference);
  }
  const JointProblem& own = first ? with_law : problem;
  Curvature curvature = curvature_of(own, state, start ? &*start : nullptr, grid);
  JointSystem system(own, static_cast<int>(state.alpha.size()), 1);
  const Eigen::Index phis = system.layout().phi_count;
  if (system.layout().chained && curvature.law_bend.empty()) return std::nullopt;
  sums.beyond = std::move(curvature.beyond);
  sums.third = std::move(curvature.third);
  const MatrixXd bend = along(sums.third, offset);
  JointState at = state;
  int evaluations = 0;
  for (int q = 0; q < SigmaGrid::nodes; ++q) {
    const Vector2d sigmas = grid.node(q).array().exp();
    at.noise.parameters[0] = sigmas.x();
    at.sigma_theta_rad = sigmas.y();
    if (start && !start->set(VectorXd::Unit(SigmaGrid::nodes, q), phi)) return std::nullopt;
    const double joint = settle_stops(system, at, evaluations);
    if (!std::isfinite(joint)) return std::nullopt;
    VectorXd g = (system.reduced_gradient() + system.log_det_gradient(at)).head(phis);
    MatrixXd H = system.schur().topLeftCorner(phis, phis) + sums.beyond;
    if (start) {
      const WalkStart::Share share = start->share(system, at);
      g += share.gradient + share.log_det_gradient + curvature.slope;
      H += share.schur;
    }
    if (system.layout().chained) {
      LastPose law = law_of_last(system, at, start ? &*start : nullptr);
      law.bend = curvature.law_bend;
      law.turn = curvature.law_turn;
      law = law.moved(offset);
      if (!sums.last_pose) {
        sums.last_pose = std::move(law);
      } else {
        sums.last_pose->mean.push_back(std::move(law.mean[0]));
        sums.last_pose->slope.push_back(std::move(law.slope[0]));
        sums.last_pose->covariance.push_back(std::move(law.covariance[0]));
      }
    }
    sums.value[q] = laplace_nll(system, joint) + g.dot(offset) + 0.5 * offset.dot(H * offset) +
                    offset.dot(bend * offset) / 6.0;
    sums.gradient.push_back(g + H * offset + 0.5 * bend * offset);
    sums.hessian.push_back(H + bend);
  }
  return sums;
}

Vector2d log_sigmas_of(const JointState& state) {
  return {std::log(state.noise.parameters[0]), std::log(state.sigma_theta_rad)};
}

VectorXd phi_of(const JointState& state) {
  VectorXd phi(state.alpha.size() + 2 * static_cast<Eigen::Index>(state.landmarks.size()));
  phi.head(state.alpha.size()) = state.alpha;
  for (std::size_t l = 0; l < state.landmarks.size(); ++l)
    phi.segment<2>(state.alpha.size() + 2 * static_cast<Eigen::Index>(l)) = state.landmarks[l];
  return phi;
}

}  // namespace rangecal
