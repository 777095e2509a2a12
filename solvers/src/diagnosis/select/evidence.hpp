// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/rows.hpp"
#include "diagnosis/select/hypothesis.hpp"
#include "diagnosis/select/priors.hpp"

namespace rangecal::diagnosis {

/// How many members this recording could have: names of the catalogue that it can hold, and places of curves without one.
struct MemberCounts {
  double names = 1.0, places = 1.0;
};
MemberCounts count_members(const Rows& rows, double places);

/// ln of the prior mass of the set of members after the first `known`, over that of none [nats]:
///
///   sum_i ln w_i + (n - 1) ln q,   w = (1 - c) / N of a name, c / M of a curve without one
///
/// c, q of SelectionPriors, N names and M places that this recording could have.
double log_prior_mass(const Model& model, std::size_t known, const MemberCounts& counts,
                      const SelectionPriors& priors);

/// What one name more changes in that, after the first [nats].
double log_prior_of_one_more_name(const MemberCounts& counts, const SelectionPriors& priors);

/// ln of the prior density of a parameter of a name at `value`: Student's t at its typical size where the change is linear in it, else
/// uniform within its bounds, or in its logarithm where these are positive and lie a hundredfold apart.
double log_prior_density(const EffectParameter& parameter, double low, double high, double value,
                         const SelectionPriors& priors);
/// That of some parameters of a name together, of all of which `parameters` holds values: the product; of sizes that are alike
/// Student's t of as many dimensions, whose heavy tail is that of what they have in common.
double log_prior_density(const Rows& rows, const Effect& effect, const std::vector<int>& indices,
                         const Eigen::VectorXd& parameters, const SelectionPriors& priors);
/// How wide that prior is about `value`: no parameter is less certain.
double prior_width(const EffectParameter& parameter, double low, double high, double value);
/// The same of a parameter of a model.
double prior_width(const Rows& rows, const Model& model, const FreeParameter& p);

/// What choosing the parameters of the members after the first `known` costs [nats], at most 0: the integral of the
/// likelihood over them against its maximum, by Laplace's method over all of them together,
///
///   ln of  (2 pi)^(k/2) |C|^(1/2) prod_a p_a(theta_a) x N(c; 0, S + tau^2 I),
///
///   C    covariance of the k parameters that move means and variances, the calibration integrated out
///   p_a  prior of a parameter of a name, by `log_prior_density`, of those that are alike together; one of as many as its grid has
///        for one that is chosen from a list
///   c, S parameters of a curve without a name and their part of C; tau its size, the likeliest; ln of the
///        shapes and sizes that it was chosen from comes off
///
/// Parameters of dependence, tails and errors of the stops enter by the curvature of the likelihood along each, in its
/// logarithm where it is positive, their prior Student's t; those next to a bound by quadrature from it on.
double log_parameter_volume(const Rows& rows, const Fit& fit, std::size_t known, const RefitOptions& options,
                            const SelectionPriors& priors);

/// 1/2 ln of the determinant of the covariance of alpha and the landmarks, the parameters of the members given [nats]: what the
/// integral over them adds, up to what all sets have in common. Members that move means leave it as it is; those that weigh the
/// readings anew do not.
double log_calibration_volume(const Rows& rows, const Fit& fit);

}  // namespace rangecal::diagnosis
