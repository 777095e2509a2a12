// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/diagnosis/scene_covariance.hpp"

#include <cmath>

#include "diagnosis/calibrated.hpp"
#include "rangecal/core/scaled_inverse.hpp"
#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {
namespace {

/// Inverse over the globals that some reading speaks of, zero for the others; nothing where it is singular.
std::optional<Eigen::MatrixXd> inverse_of_known(const Eigen::MatrixXd& schur) {
  std::vector<Eigen::Index> known;
  for (Eigen::Index i = 0; i < schur.rows(); ++i)
    if (schur(i, i) > 0.0) known.push_back(i);
  const std::optional<UnitDiagonalInverse> own = unit_diagonal_inverse(schur(known, known));
  constexpr double singular = 1e9;  // of a matrix of unit diagonal: rounding has taken over
  if (!own || own->inverse.diagonal().maxCoeff() > singular) return std::nullopt;
  Eigen::MatrixXd inverse = Eigen::MatrixXd::Zero(schur.rows(), schur.cols());
  inverse(known, known) = own->scale.asDiagonal() * own->inverse * own->scale.asDiagonal();
  return inverse;
}

}  // namespace

SceneCovariance scene_covariance(std::span<const Recording> recordings, const Calibration& calibration) {
  const diagnosis::Calibrated fit = diagnosis::calibrated(recordings, calibration);
  SceneCovariance result;
  if (fit.rows.pairs) return result;
  const JointProblem problem = diagnosis::working_problem(fit.rows, fit.model, fit.state).problem;
  result.stops.resize(problem.stops.size());
  result.landmarks.resize(problem.landmark_radius_m.size());
  JointSystem system(problem, static_cast<int>(fit.state.alpha.size()),
                     static_cast<int>(fit.state.noise.parameters.size()));
  JointState state = fit.state;
  if (problem.estimate_sigma_s && !(state.sigma_s_m.value_or(0.0) > 0.0)) return result;
  if (!std::isfinite(system.assemble(state, HessianKind::fisher)) || !system.eliminate()) return result;
  const std::optional<Eigen::MatrixXd> globals = inverse_of_known(system.schur());
  if (!globals) return result;
  const JointLayout& layout = system.layout();
  for (std::size_t l = 0; l < result.landmarks.size(); ++l) {
    const Eigen::Index at = layout.landmark_begin + 2 * static_cast<Eigen::Index>(l);
    if ((*globals)(at, at) > 0.0) result.landmarks[l] = globals->block<2, 2>(at, at);
  }
  Eigen::MatrixXd follow(static_cast<Eigen::Index>(layout.coordinates), layout.global_count);
  for (int e = 0; e < layout.global_count; ++e)
    follow.col(e) = system.back_substitute(Eigen::VectorXd::Unit(layout.global_count, e), false);
  for (std::size_t j = 0; j < layout.nodes.size(); ++j) {
    const JointLayout::Node& node = layout.nodes[j];
    if (!node.free_position) continue;
    const auto own = follow.middleRows(static_cast<Eigen::Index>(node.coordinate), 2);
    const Eigen::Matrix2d covariance =
        system.stop_covariance(static_cast<int>(j)).topLeftCorner<2, 2>() + own * *globals * own.transpose();
    for (int k : node.stops) result.stops[static_cast<std::size_t>(k)] = covariance;
  }
  return result;
}

}  // namespace rangecal
