// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "diagnosis/generic.hpp"
#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Named effects of a model whose curves are one: the same kind of change of one channel along one covariate. 1/d
/// (disparity) is a function of d, and so is a constant offset of the ranges: beside a curve of the range they cannot be
/// told apart as curves.
struct LocatedCurve {
  std::string channel, covariate;
  Model effects;
  std::vector<int> numbers;  ///< of the effects in the model
};
std::vector<LocatedCurve> located_curves(const Model& model);

/// Where the seed model and the recording differ, entered into `result.location`, which is ordered by p (ties by share).
///
/// Named effects: one finding for each curve of theirs, with
///   p      of 2 (l_without - l_with) as chi-square of its free parameters, l the marginal NLL, all the rest refitted,
///          corrected for the starts of its effects and for everything that was looked at;
///   share  (s^2 / I - k) / (X - n) with s, I score and information of its fitted curve in the seed model, spreads
///          held, k its parameters, X and n chi-square and degrees of freedom of the seed model's cell means; none
///          where X - n < 2 sqrt(2 n), or where it changes no mean;
///   place  where its fitted curve, less what the calibration takes of it, is half as large as it gets, or larger.
/// What else the scan of the seed model saw has p by what a fit of its shape would gain. In an explained recording that
/// is confounded with the names along other covariates: it belongs to them, and is worth no more than they are (what effects
/// that were asked for leave at p < 1e-5 belongs to none). Where no name was given, dependence, tails and errors of stops are
/// worth no more than the change of a mean that they are confounded with.
/// `generic`: the curve without a name, or null. There is at least one finding wherever there is a mismatch.
void add_location(const Rows& rows, const SearchResult& found, const GenericModel* generic,
                  Diagnosis& result);

/// By p; ties by share, then as they stand.
void order_location(std::vector<Finding>& location);

}  // namespace rangecal::diagnosis
