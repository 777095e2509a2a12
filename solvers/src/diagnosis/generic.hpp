// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <memory>
#include <optional>
#include <vector>

#include "diagnosis/generic_effect.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// The curve of the model below, as readings' changes.
struct GenericCurve {
  std::vector<double> knots, values, std_dev;  ///< covariate, change of the reading [m] or [rad]
  double gain = 0.0;                           ///< nats
  Eigen::VectorXd row_change;                  ///< per row, in the finding's channel
};

/// The smooth correction that stands in for an unexplained mismatch, as an effect without a name:
///
///   delta y = sum_k h_k(x) sum_j V_kj a_j     [m], [rad], or change of log variance
///     x the located covariate, h_k hats over knots at equal shares of the readings (indicators for groups;
///     cosine and sine of one wavenumber for a periodic finding), V an orthonormal basis of what the
///     calibration does not absorb, a the parameters
///
/// The number of knots is the one of highest penalised gain, gain - dof/2 log(2 cells), so that the curve is
/// as smooth as the readings ask. It then is fitted like any effect: marginal ML, all nuisances free.
struct GenericModel {
  std::shared_ptr<Effect>
      effect;  ///< null if the finding is of a kind that no curve corrects (tails, labels, ...)
  Fit fit;
  GenericCurve curve;
};

/// For each root L, of the covariance L L^T that a basis's coefficients have: the directions of L a, a independent with one standard
/// deviation, that the calibration leaves, of a ten-thousandth of the largest information or more. x: the covariate at every reading.
std::vector<Eigen::MatrixXd> directions_left(const Rows& rows, const Projector& projector,
                                             CurveChannel channel, const Eigen::VectorXd& x,
                                             const CurveBasis& basis,
                                             const std::vector<Eigen::MatrixXd>& roots);

/// A curve over one covariate, added to a model and fitted.
struct CurveFit {
  std::shared_ptr<GenericEffect> effect;
  CurveChannel channel = CurveChannel::none;
  Fit fit;
};

/// Adds to `base` the curve for the channel and covariate of a question, the projector being that of `base`. None for
/// what no curve corrects, and where it does not fit better.
std::optional<CurveFit> fit_curve(const Rows& rows, const Projector& projector, const Fit& base,
                                  const Question& question, const RefitOptions& options);

GenericModel fit_generic_model(const Rows& rows, const SearchResult& found, const RefitOptions& options);

}  // namespace rangecal::diagnosis
