// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the parameter belongs to a tail's law, whose slope is computed reading by reading.
bool is_of_tail(const Model& model, const FreeParameter& p);

/// d ln p(e_i) / d ln p_k [rows x parameters]: slopes of the log density of every reading's error e_i under the laws of the
/// model's tails; its spread is exp(log_level) times that of `working` and `geometry`. 0 for parameters of no tail.
/// `of_log_spread`: if not null, gets the slopes in ln s.
SerialErrors::Columns tail_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                                  const CellGeometry& geometry, const std::vector<FreeParameter>& parameters,
                                  double log_level = 0.0, Eigen::VectorXd* of_log_spread = nullptr);

/// The model with the likeliest parameters of its tails, the readings' errors held at those of the fit, by scoring in
/// u = ln p and ln s together,
///
///   g_i = d ln p(e_i) / d(u, ln s),   information = sum g_i g_i^T (Berndt, Hall, Hall, Hausman 1974)
///
/// with the sum of the slopes in ln s at the start subtracted, because the calibration has already fitted s there. A step is
/// one pass over the readings.
Model likeliest_tails(const Rows& rows, const Fit& fit, const std::vector<FreeParameter>& tails);

}  // namespace rangecal::diagnosis
