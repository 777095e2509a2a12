// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"

namespace rangecal::diagnosis {

/// True if the parameter is of a tail's law, which knows every reading's slope.
bool is_of_tail(const Model& model, const FreeParameter& p);

/// d ln p(e_i) / d ln p_k [rows x parameters] of every reading's error e_i under the laws of the model's tails, `working` and
/// `geometry` being its own: 0 for what is no parameter of a tail.
SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry, const std::vector<FreeParameter>& parameters);

}  // namespace rangecal::diagnosis
