// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/closed_form/landmarks_from_bearings.hpp"
#include "rangecal/solvers/closed_form/polynomial_fit.hpp"

namespace rangecal {

/// Which program finds the joint maximum (`full`, kind landmarks). Both reach the same optimum.
enum class JointSolver { ceres, block };
/// "block", "ceres"; the inverse throws InputError for another text.
const char* to_string(JointSolver solver);
JointSolver joint_solver_from_string(const std::string& text);

struct CalibrateOptions {
  std::vector<Method> methods;  ///< in the order wanted; empty: all
  std::optional<int> order;     ///< of f; nullopt: 1 .. max_order by AIC of the marginal NLL
  int max_order = 4;            ///< of that search
  /// Of pairs. nullopt: a polynomial in the distance; where the readings fall with distance, that or a reciprocal, the one of lower
  /// criterion; a spline where low orders do not suffice (docs/which-estimator.md). A reciprocal's order and noise law are chosen together
  /// with its offset, each offset by maximum likelihood; a spline has no order.
  std::optional<CurveFamily> curve;
  std::optional<NoiseLaw> noise;  ///< nullopt: constant, f, f2, f3 by AIC of the same
  /// In place of AIC, for pairs alone. Cross-validation and thirds (2021 section 3.2) choose the order: the mean square
  /// error of left-out readings, each weighed by its noise as the model of lowest AIC has it; the law goes by AIC.
  OrderCriterion criterion = OrderCriterion::aic;
  JointSolver solver = JointSolver::block;  ///< of `full`, of landmarks
  /// Of ranges and bearings, each for itself where `automatic`. The closed forms know the Gaussian only and see the
  /// readings that agree with most others (find_consensus); `gaussian`: all of them, for studies.
  NoiseShape noise_shape = NoiseShape::automatic;
  BearingWeights weights = BearingWeights::consistent;  ///< of the closed form's lines of sight
  bool check = false;  ///< minimise the full likelihood a second time with NLopt
  std::optional<Calibration>
      from;  ///< start from this one's alpha and noise, and landmarks whose labels match
  std::function<void(const std::string&)> on_progress;  ///< told in words what begins
  std::function<void(Method, bool)> on_method;          ///< told when a method begins (true) and ends (false)

  /// Throws InputError naming the bad field and its value.
  void check_values() const;
};

/// One model of the search for order and noise law, under the noise shapes kept.
struct ModelScore {
  int order = 0;
  NoiseLaw law = NoiseLaw::f_squared;
  double nll = 0.0, aic = 0.0;  ///< marginal (pairs: plain) [nats]; infinity where it did not converge
  CurveFamily family = CurveFamily::polynomial;
};

/// The criterion of a model on so many readings [nats], its k = aic / 2 - nll parameters counted; of cross-validation and
/// thirds, which no likelihood has, AIC. Infinity where the model did not converge.
double criterion_of(const ModelScore& model, OrderCriterion criterion, double readings);

/// What the second program said about the full likelihood's optimum.
struct CheckReport {
  bool agrees = false;        ///< NLL within 1e-6 nats
  bool better_basin = false;  ///< something lower than the optimum was found
  double nll = 0.0;           ///< lowest NLL of the second program [nats]
  std::string report;         ///< one sentence
};

struct CalibrationReport {
  std::vector<Calibration> calibrations;  ///< one per method, in the order asked for
  std::vector<ModelScore> models;         ///< tried, in the order of trial; empty where nothing was to choose
  std::vector<std::string> notes;         ///< what was done to the input, one sentence each
  std::optional<CheckReport> check;
  std::string noise_shape;  ///< of the likelihood where it is not Gaussian, with its parameters
  OrderCriterion criterion = OrderCriterion::aic;  ///< that `models` were compared by
};

/// "student-t with nu = 4.2 +- 0.5"; "contaminated: 8 % of the readings with 12 times the spread".
std::string in_words(const ShapeEstimate& shape);

/// Calibrates one sensor from one or several recordings of one kind. Order and noise law are chosen once,
/// with the recommended method's likelihood, and shared by all methods, so that these can be compared.
///
/// Of the iterative methods each starts from the better of closed form and position seed (by joint NLL);
/// `marginal` from the optimum of `full` or, where that is unbounded or sigma_xy_m is estimated, from the fit
/// with all sigmas held at the approximate estimate. All methods are scored by the same two functions
/// (laplace_marginal at their alpha, noise and landmarks); AIC = 2 (marginal NLL + parameters of alpha,
/// noise, sigma_theta and landmarks, sigma_s where estimated).
///
/// Noise shapes (landmarks). First the readings that agree (find_consensus): closed forms, seeds and Gaussian solves see
/// these. `marginal` is then fitted to all readings with the shapes asked for, or with those of lowest AIC for each channel
/// (solve_marginal_robust); order and law, where free, are chosen again under them. `full` has the same shapes, held, and
/// ends as `unbounded` where a sigma falls below 0.4 of marginal's. All methods are scored by the same two functions with
/// the shapes in them (robust_nll). `automatic` keeps the Gaussian where no reading is an outlier, and where it
/// predicts stops left out better. Pairs likewise, with agreeing_pairs.
///
/// `marginal` is checked: standard deviations by stops, and whether the curve is better than none (Calibration::left_out).
/// Where an order was to be chosen, one below AIC's that predicts stops left out better, by more than a standard error,
/// takes its place; of pairs, one nearly as likely that predicts no worse than within that.
///
/// Throws InputError for recordings of different kinds, options out of range, a criterion that there is not for
/// landmarks, and `full` asked by name where
/// sigma_xy_m is `estimate` (asked for as one of all, it is reported as unbounded). Everything else is an
/// outcome: fewer than 3 places to stand or fewer readings than unknowns: too_few_data; distances that do not
/// differ, landmarks and path on one line: unobservable with the direction named. Cost: about 10 marginal
/// solves where order and law are searched.
CalibrationReport calibrate_report(std::span<const Recording> recordings,
                                   const CalibrateOptions& options = {});

/// The same, the calibrations alone.
std::vector<Calibration> calibrate(std::span<const Recording> recordings,
                                   const CalibrateOptions& options = {});

}  // namespace rangecal
