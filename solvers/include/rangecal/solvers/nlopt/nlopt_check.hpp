// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <functional>
#include <limits>
#include <string>
#include <vector>

namespace rangecal {

/// Objective [nats] at x and, where not null, its gradient. Infinity or NaN outside of the domain.
using Objective = std::function<double(const Eigen::VectorXd& x, Eigen::VectorXd* gradient)>;

/// A problem to be minimised once more, by NLopt. Its stopping rules use one length for all coordinates, and quasi-Newton methods stall
/// where scales differ, so the local search runs in u, x = seed + whitening u.
struct NloptProblem {
  Objective objective;
  Eigen::VectorXd seed;
  Eigen::MatrixXd whitening;     ///< d x / d u, square: L^-T with L L' the expected information at the seed
  Eigen::VectorXd lower, upper;  ///< bounds of x for the global search; empty: no global search
  std::vector<int>
      global_indices;  ///< coordinates that the global search moves (alpha, say); the others stay at the best local point
  Objective global_objective;  ///< optional: takes the moved coordinates alone, the rest profiled out
};

struct NloptOptions {
  double reference_nll = std::numeric_limits<double>::quiet_NaN();  ///< of the solver under check; NaN: none
  double agreement = 1e-6;                                          ///< [nats]
  int local_evaluations = 20000;
  int global_evaluations = 2000;
};

struct NloptCheck {
  Eigen::VectorXd x;  ///< best of all
  double nll = std::numeric_limits<double>::infinity();
  double local_nll = std::numeric_limits<double>::infinity();   ///< from the seed
  double global_nll = std::numeric_limits<double>::infinity();  ///< of the global search, polished
  std::string algorithm;                                        ///< the local one that went lowest
  int evaluations = 0;
  bool agrees = false;        ///< |nll - reference| within the agreement
  bool better_basin = false;  ///< a point lower than the reference by more than the agreement was found
  std::string report;         ///< one sentence
};

/// Runs LD_LBFGS, LD_TNEWTON_PRECOND_RESTART and LD_SLSQP in turn, each from the best point so far, until a round gains nothing; then,
/// where bounds are given, GN_DIRECT_L over global_indices, and the same from its best point. NLopt's algorithms are
/// deterministic here. Throws InputError for sizes that do not match and a seed outside of the domain.
/// Cost: some hundred evaluations locally, global_evaluations globally.
NloptCheck nlopt_check(const NloptProblem& problem, const NloptOptions& options = {});

/// L^-T of an information matrix: columns are directions of one standard deviation. A matrix that is not positive definite
/// gets a growing ridge (1e-12 to 0.1 of the scaled diagonal), so that directions without information become very long; the diagonal alone
/// where even that fails.
Eigen::MatrixXd whitening_from_information(const Eigen::MatrixXd& information);

}  // namespace rangecal
