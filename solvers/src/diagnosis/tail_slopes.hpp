// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the parameter belongs to a tail's law, whose slope is computed reading by reading.
bool is_of_tail(const Model& model, const FreeParameter& p);

/// True if some tail is measured by the calibration's spread.
bool is_measured_by_spread(const Rows& rows, const CellGeometry& geometry, const Model& model);

/// Slopes of the log density ln p(e_i) - ln s_i of every row's error: by differences in ln s_i, where the sizes of the tails stay, and where
/// the calibration's spread moves, which some tails are measured by; and in the logarithm of every parameter of a tail, 0 for the
/// others [rows x parameters].
struct LawSlopes {
  Eigen::VectorXd in_spread, in_level;
  SerialErrors::Columns in_parameters;
};

LawSlopes law_slopes(const Rows& rows, const Model& model, const WorkingProblem& working,
                     const CellGeometry& geometry, const std::vector<FreeParameter>& parameters);

/// The model with the likeliest parameters of its tails, the readings' errors held at those of the fit, by scoring in
/// u = ln p and ln s together,
///
///   g_i = d ln p(e_i) / d(u, ln s),   information = sum g_i g_i^T (Berndt, Hall, Hall, Hausman 1974)
///
/// with the sum of the slopes in ln s at the start subtracted, because the calibration has already fitted s there. A step is
/// one pass over the readings.
Model likeliest_tails(const Rows& rows, const Fit& fit, const std::vector<FreeParameter>& tails);

}  // namespace rangecal::diagnosis
