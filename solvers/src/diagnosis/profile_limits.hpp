// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// Uncertainty of the parameters that only the value of the likelihood knows: dependence, tails, errors of
/// stops.
///
/// With the restricted NLL, all else refitted (Patterson and Thompson 1971; its second term counts the
/// degrees of freedom that alpha and the landmarks, phi, take from a variance),
///   l(u) = l_s(u) + 1/2 log det I_phi(u),   u = log p of a parameter that is positive, else u = p:
///   estimate     where l is lowest;
///   covariance   H^-1, H the second differences of l there;
///   95 % limits  where l has risen by 1.92 nats (half the 95 % quantile of chi-square with one degree of
///   freedom), the other
///                such parameters moved along with it as H says.
/// An estimate at its lower bound has one limit, above, where l has risen by 1.35 (one-sided 95 %).
///
/// Moves the fit to that estimate, with its l_s, and fills `fit.limits` and these parameters' share of
/// `fit.covariance`. About ten refits of the calibration for each side of a parameter.
void add_profile_limits(const Rows& rows, const RefitOptions& options, Fit& fit);

/// l of the model at its parameters, the calibration refitted from `state`, which moves to the fit.
double restricted_nll(const Rows& rows, const Model& model, const RefitOptions& options, JointState& state);

}  // namespace rangecal::diagnosis
