// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/marginal/marginal.hpp"

namespace rangecal {

/// The families of both channels. `automatic` for one of them: that channel's is chosen.
struct ChannelShapes {
  ChannelShapes(NoiseShape both) : range(both), bearing(both) {}  // NOLINT(google-explicit-constructor)
  ChannelShapes(NoiseShape of_range, NoiseShape of_bearing) : range(of_range), bearing(of_bearing) {}

  bool gaussian() const { return range == NoiseShape::gaussian && bearing == NoiseShape::gaussian; }
  bool automatic() const { return range == NoiseShape::automatic || bearing == NoiseShape::automatic; }

  NoiseShape range, bearing;
};

/// What robust noise shapes add to a fit. Ranges and bearings have families and shape parameters of their own.
struct RobustShapes {
  NoiseShapeParameters range, bearing;
  /// Standard deviations of their parameters, in their order (nu; p, k; p, outlier_mean); empty where there are none, or
  /// one is at the end of its range.
  std::vector<double> range_std, bearing_std;
  double nll = 0.0;    ///< of the shapes delivered: joint for `full`, Laplace's for `marginal` [nats]
  double aic = 0.0;    ///< 2 (nll + parameters: globals not held and shapes)
  int iterations = 0;  ///< of expectation and maximisation
  /// `automatic`: each family at the residuals of one channel, its AIC less the best one's.
  std::vector<std::pair<NoiseShape, double>> range_tried, bearing_tried;
};
struct RobustJointFit {
  JointFit fit;
  RobustShapes shapes;
};
struct RobustMarginalFit {
  MarginalFit fit;
  RobustShapes shapes;
};

/// Both likelihoods with given shapes.
struct RobustNll {
  bool ok = false;        ///< false: the state lies outside of the domain, or its stops have no optimum
  double joint = 0.0;     ///< at the state's stops [nats]
  double marginal = 0.0;  ///< joint + Laplace's part for the stops, by the weighted squares [nats]
};

/// The joint likelihood with outliers, per reading i of range (and of bearing likewise):
///
///   -log p = log s_i - log rho(z_i; s_i),   z_i = (y_i - f(d_i)) / s_i,   rho: a NoiseShape of scale 1.
///
/// Expectation and maximisation (Dempster, Laird, Rubin 1977; Student's t: Lange, Little, Taylor 1989). Given the
/// residuals, a reading is a Gaussian one of weight w_i (t: (nu + 1) / (nu + z^2); contaminated: the mean of 1 or 1 / k^2)
/// whose error has the expected echo taken off (one-sided); the readings of a cell are summed up under their weights and
/// solve_joint_block does the rest. Between two solves the shape's parameters and a factor on sigma are renewed together
/// at the residuals (fit_residual_shape), since these two creep where they take turns.
///
/// `automatic` chooses each channel's family: the Gaussian fit stays where neither channel's residuals have an outlier
/// (may_have_outliers); else the families are compared by AIC at the residuals of the start (or of the Gaussian fit, where
/// Student's t finds the readings likelier there), the best ones are fitted and compared again at their residuals, up to
/// three times. Of these fits the one of the lowest AIC is kept, if that is more than 4 below the Gaussian's. `start` should be one that outliers do
/// not break: a fit to the readings that agree (find_consensus).
/// Covariances are those of the likelihood of the shapes, whose parameters are estimated beside all else: what the
/// weighted Gaussian says is corrected by what a reading of the shape is expected to tell (shape_information). A shape
/// parameter at the end of its range counts as known.
///
/// The joint likelihood with a mixture's scale free has no maximum worth its name: the stops can fit half of the readings
/// exactly and the mixture take the rest. A fit whose sigma of a channel falls below a third of the start's, while the
/// start is that of `marginal`, is one; solve_joint_with_shapes, which holds the shapes, is the remedy.
///
/// `rows` has one reading per cell (Grouping::rows), or several that are alike (rows_alike), else InputError. Cost: some 5 to 20 solves from warm starts.
RobustJointFit solve_joint_robust(const JointProblem& rows, const JointState& start, ChannelShapes shapes,
                                  const JointOptions& options = {});

/// The same around solve_marginal: the weights are taken at the stops' conditional optimum, nll is l_s of the weighted fit
/// with its Gaussian share replaced by that of the shapes, and nu allows for the parameters fitted as sigma does. `rough`: to
/// about a hundredth of a nat, or a dozen iterations, as models are told apart by.
RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start,
                                        ChannelShapes shapes, const MarginalOptions& options = {},
                                        bool rough = false);

/// From a fit of other curve or noise law: its shapes are where the search begins, and its families are kept.
RobustMarginalFit solve_marginal_robust(const JointProblem& rows, const JointState& start,
                                        const RobustShapes& shapes, const MarginalOptions& options = {},
                                        bool rough = false);

/// The families of lowest AIC at the residuals of a fit, where one of them is better by more than 4: what to fit next.
/// None where the fit's own are as good.
std::optional<RobustShapes> better_shapes(const JointProblem& rows, const JointState& state,
                                          const RobustShapes& shapes);

/// `full` with the shapes' parameters held at those given; sigmas are estimated.
RobustJointFit solve_joint_with_shapes(const JointProblem& rows, const JointState& start,
                                       const RobustShapes& held, const JointOptions& options = {});

/// The likelihoods that these minimise, at a given state: what `nll` is made of, for scores side by side.
/// Throws InputError unless every cell holds one reading. Cost: linear in the readings.
RobustNll robust_nll(const JointProblem& rows, const JointState& state, const NoiseShapeParameters& range,
                     const NoiseShapeParameters& bearing);

/// What the shapes make of the readings at a state: cells of Gaussian readings, of the weights and errors that the
/// shapes expect. The likelihood's scores at the state are those of this problem.
JointProblem weighted_problem(const JointProblem& rows, const JointState& state,
                              const NoiseShapeParameters& range, const NoiseShapeParameters& bearing);

/// Of every reading: its error in spreads, the spread of its range [m], and the probability that it is an outlier
/// (LogDensity::outlier). Empty at a state where a distance or a spread is not positive.
struct ReadingErrors {
  std::vector<double> range_z, range_s, bearing_z, range_outlier, bearing_outlier;
};
ReadingErrors reading_errors(const JointProblem& rows, const JointState& state,
                             const NoiseShapeParameters& range, const NoiseShapeParameters& bearing);

}  // namespace rangecal
