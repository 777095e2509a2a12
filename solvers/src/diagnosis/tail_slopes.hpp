// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the parameter is of a tail's law, which knows every reading's slope.
bool is_of_tail(const Model& model, const FreeParameter& p);

/// d ln p(e_i) / d ln p_k [rows x parameters] of every reading's error e_i under the laws of the model's tails, its spread
/// exp(log_level) times that of `working` and `geometry`: 0 for what is no parameter of a tail. `of_log_spread`: the same
/// in ln s, where it is asked for.
SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry, const std::vector<FreeParameter>& parameters,
                                  double log_level = 0.0, Eigen::VectorXd* of_log_spread = nullptr);

/// The model with the tails' parameters that are likeliest at the errors that the readings have at the fit, by scoring of
/// u = ln p and ln s together,
///
///   g_i = d ln p(e_i) / d(u, ln s),   information = sum g_i g_i^T (Berndt, Hall, Hall, Hausman 1974)
///
/// the slope in ln s less its sum at the start, where the calibration has fitted it. A step is one pass over the readings.
Model likeliest_tails(const Rows& rows, const Fit& fit, const std::vector<FreeParameter>& tails);

}  // namespace rangecal::diagnosis
