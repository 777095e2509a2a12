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

/// What is to be minimised a second time, by another program. Optimisers stop by size in all coordinates alike, and
/// quasi-Newton ones stall on unlike units, so the local search runs in u with x = seed + whitening u.
struct NloptProblem {
  Objective objective;
  Eigen::VectorXd seed;
  Eigen::MatrixXd whitening;     ///< d x / d u, square: L^-T with L L' the expected information at the seed
  Eigen::VectorXd lower, upper;  ///< bounds of x for the global search; empty: no global search
  std::vector<int>
      global_indices;  ///< which x the global search moves (alpha, say); the rest is as in the best local
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

/// Minimises by LD_LBFGS, LD_TNEWTON_PRECOND_RESTART and LD_SLSQP from the seed, each polished by the other two until
/// none gains, and by GN_DIRECT_L over global_indices within the bounds, polished likewise. NLopt's algorithms are
/// deterministic here. Throws InputError for sizes that do not match and a seed outside of the domain.
/// Cost: some hundred evaluations locally, global_evaluations globally.
NloptCheck nlopt_check(const NloptProblem& problem, const NloptOptions& options = {});

/// L^-T of an information matrix: columns are directions of one standard deviation. Directions without information
/// get the scale of the diagonal.
Eigen::MatrixXd whitening_from_information(const Eigen::MatrixXd& information);

}  // namespace rangecal
