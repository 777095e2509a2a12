// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "calibrate/choice.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/closed_form/consensus.hpp"
#include "rangecal/solvers/joint_ml/joint_ml.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"
#include "rangecal/solvers/nlopt/nlopt_check.hpp"
#include "rangecal/solvers/robust/robust.hpp"

namespace rangecal {

/// What a search for order and noise law chose, and the fits of Gaussian noise that it made, to a thousandth of a standard
/// deviation.
struct SearchedModels {
  int order;
  NoiseLaw law;
  std::map<OrderAndLaw, MarginalFit> fits;

  /// The fit of a model, where there is one that converged.
  const MarginalFit* at(int of_order, NoiseLaw of_law) const {
    const auto found = fits.find({of_order, of_law});
    return found != fits.end() && found->second.outcome == Outcome::converged ? &found->second : nullptr;
  }
};

/// The recordings of kind landmarks of one calibration job, concatenated, with the labels that the indices of the joint
/// problem stand for.
struct LandmarksJob {
  LandmarksJob(std::span<const Recording> all, const CalibrateOptions& wanted, CalibrationReport& report);

  std::vector<Recording> recordings;  ///< without the landmarks that no reading sees
  CalibrateOptions options;
  JointProblem problem;
  /// What closed forms, seeds and Gaussian solves use: `problem`; if a noise shape is asked for, only the readings that
  /// agree (find_consensus).
  JointProblem agreeing;
  std::optional<JointProblem> rows;  ///< each reading a cell of its own, where a noise shape is asked for
  Consensus consensus;               ///< of `rows`; its problem is `agreeing`
  std::vector<std::string> landmark_labels, stop_labels;
  Counts counts;
  std::optional<std::string> too_few;  ///< why no method can work, in words
  double default_sigma_s_m = 0.01;     ///< start of sigma_s where it is estimated

  std::optional<JointState> seed(int order, NoiseLaw law) const;  ///< the better of all seeds by joint NLL
  JointFit full(const JointState& start) const;
  MarginalOptions marginal_options() const;  ///< with sigma_s free where it is to be estimated
  /// Starts from `near` if given, a fit of the same model; else from `full` where it converged, else from the fit with sigmas
  /// held. If that ends higher than the seed, or does not converge, starts from the seed itself too.
  MarginalFit marginal(const JointState& seed, const JointFit* full, const MarginalFit* near = nullptr) const;
  /// The REML criterion l_s + 1/2 log det A at the sigmas of `state`, alpha and landmarks at their optimum from there.
  double reml_at(const JointState& state) const;
  MarginalFit marginal_by_joint(const JointState& seed, const JointFit* full,
                                const MarginalOptions& options) const;
  /// Order and noise law of Gaussian noise, by the AIC of the marginal NLL; every model tried goes to `models`, its curve
  /// to `curves`.
  SearchedModels choose_model(std::vector<ModelScore>& models, std::vector<TriedCurve>& curves) const;
  /// The noise shapes that were asked for, at the order and law of `start`, the optimum with Gaussian noise on the agreeing
  /// readings; `reml`: the slopes there, if they are known. None if a Gaussian is best for both channels. Order and
  /// law are then chosen again under these families, and the families again for the chosen model; `models` and `curves` get
  /// those tried with them.
  std::optional<RobustMarginalFit> choose_shapes(const JointState& start,
                                                 const std::optional<RemlSlopes>& reml,
                                                 std::vector<ModelScore>& models,
                                                 std::vector<TriedCurve>& curves) const;
  /// For the case that all readings agree and no noise shape is needed.
  void take_all_readings();

  /// `from` with another order and noise law, as near to its own curve and noise as they can be over the distances of the
  /// cells: least squares between the curves, equal spreads on average. Uses no readings, so outliers have no influence.
  JointState restated(const JointState& from, int order, NoiseLaw law) const;
  int highest_order() const;  ///< that the readings can determine, up to max_order
  void say_trying(const OrderAndLaw& model) const;
  double parameters(
      const JointState& state) const;  ///< alpha, noise, sigma_theta, landmarks, sigma_s if estimated
};

/// The number of parameters for AIC: alpha, the noise's, the landmarks' coordinates, sigma_theta, and sigma_s where the
/// problem estimates it. For pairs laid out as a joint problem (`pairs`): curve and noise only.
double parameter_count(const JointProblem& problem, const JointState& state, bool pairs = false);

/// The job's answer by one method: estimates, covariances, labels, range and counts; `score` adds its likelihoods.
Calibration calibration_from_fit(const LandmarksJob& job, Method method, const JointFit& fit);
Calibration calibration_by_closed_form(const LandmarksJob& job, Method method, int order, NoiseLaw law);

/// Sets joint_nll, marginal_nll and aic, by the same two functions for every method, with the noise shapes of `shapes`
/// (null: Gaussian). `sigma_s_m`: if it was estimated; `sigma_theta_rad`: used if the method estimates none.
void score(const LandmarksJob& job, std::optional<double> sigma_s_m, std::optional<double> sigma_theta_rad,
           const RobustShapes* shapes, Calibration& calibration);

/// "landmark 3" -> "landmark T6" throughout.
std::string with_labels(const std::string& text, const std::vector<std::string>& labels);
/// The same, and "noise parameter 0" is replaced by the law's symbol.
std::string in_user_words(const std::string& direction, const std::vector<std::string>& labels, NoiseLaw law);

void calibrate_landmarks(std::span<const Recording> recordings, const CalibrateOptions& options,
                         CalibrationReport& report);
void calibrate_pairs(std::span<const Recording> recordings, const CalibrateOptions& options,
                     CalibrationReport& report);

/// What the check by a second program (NLopt) found, as part of a report.
CheckReport check_report(const NloptCheck& check);

/// The methods wanted; all where none is named.
std::vector<Method> methods_of(const CalibrateOptions& options);
void add_counts(const Counts& from, Counts& to);

}  // namespace rangecal
