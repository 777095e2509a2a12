// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <utility>
#include <vector>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the parameter is of errors that wander along a sequence.
bool is_of_sequence(const Rows& rows, const Model& model, const FreeParameter& p);

/// A sequence's parameter between its bounds moves by its logit, which stays within +-largest_logit.
inline constexpr double largest_logit = 8.0;
double logit_between(std::pair<double, double> bounds, double value);
double at_logit(std::pair<double, double> bounds, double logit);

/// The model with those of the parameters `free` that are of errors that wander along a sequence where they make the residuals of
/// `working`, the model's own at `state`, most likely, and the state with the level of the noise at which they do, which
/// stays beside tails. None where there is no such parameter.
std::optional<std::pair<Model, JointState>> likeliest_sequence(const Rows& rows,
                                                               const std::vector<FreeParameter>& free,
                                                               const Model& model,
                                                               const WorkingProblem& working,
                                                               const JointState& state);

}  // namespace rangecal::diagnosis
