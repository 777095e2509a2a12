// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

#include "rangecal/solvers/joint_ml/joint_system.hpp"

namespace rangecal {

/// What one part of the nodes adds to the globals' own blocks.
struct JointSystem::Accumulator {
  explicit Accumulator(int globals)
      : hessian(Eigen::MatrixXd::Zero(globals, globals)), gradient(Eigen::VectorXd::Zero(globals)) {}
  Eigen::MatrixXd hessian;  ///< upper triangle
  Eigen::VectorXd gradient;
  double nll = 0.0;
};

}  // namespace rangecal
