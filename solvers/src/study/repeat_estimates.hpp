// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <list>
#include <optional>
#include <vector>

#include "calibrate/landmarks_job.hpp"
#include "rangecal/problems/pairs/pairs_problem.hpp"
#include "rangecal/solvers/study/study.hpp"

namespace rangecal {

/// What one estimator makes of one simulated recording.
struct RepeatEstimate {
  Outcome outcome = Outcome::failed;
  Eigen::VectorXd alpha;                   ///< empty: no answer
  std::vector<Eigen::Vector2d> landmarks;  ///< in the problem's order; empty for pairs
  std::optional<double> sigma_e, sigma_theta;
  std::optional<Eigen::MatrixXd> alpha_covariance;
  Eigen::VectorXd landmark_variance;  ///< 2 L; empty where there is none
  std::vector<double> aic_by_order;   ///< from order 1; empty where the order is given
  double shared_seconds = 0.0;        ///< of a solve that an earlier estimator made and this one needs

  bool answered() const { return outcome == Outcome::converged && alpha.size() > 0; }
};

/// Processor time of this thread [s]: what others do on the machine does not count.
double thread_seconds();

/// What the study asks of one estimator at one point.
struct RepeatModel {
  std::optional<int> order;
  int max_order = 4;
  NoiseLaw law = NoiseLaw::f_squared;
};

/// The four methods on one recording of kind landmarks, started as `calibrate` starts them, with the block solver;
/// what several estimators need is solved once.
class LandmarkEstimates {
 public:
  explicit LandmarkEstimates(const Recording& recording);

  const JointProblem& problem() const { return job_.problem; }
  /// Index of the recording's landmark behind each landmark of the problem.
  const std::vector<int>& seen() const { return seen_; }
  RepeatEstimate estimate(const StudyEstimator& estimator, const RepeatModel& model);

 private:
  struct Joint {
    int order = 0;
    NoiseLaw law = NoiseLaw::f_squared;
    std::optional<JointState> seed;
    JointFit full;
    double seconds = 0.0;
  };
  /// Seed and joint optimum at one order and law, solved when first asked for.
  const Joint& joint(int order, NoiseLaw law, RepeatEstimate& estimate);
  RepeatEstimate closed(const StudyEstimator& estimator, const RepeatModel& model) const;
  int selected_order(const RepeatModel& model);

  CalibrationReport report_;
  LandmarksJob job_;
  std::vector<int> seen_;
  std::list<Joint> joints_;
};

/// The four methods on one recording of kind pairs. With the order selected, `aic_by_order` holds the AIC of every
/// order tried, counting sigma as a parameter.
RepeatEstimate estimate_pairs(const Recording& recording, const PairsProblem& problem,
                              const StudyEstimator& estimator, const RepeatModel& model);

}  // namespace rangecal
