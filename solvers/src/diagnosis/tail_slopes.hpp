// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <vector>

#include "diagnosis/free_parameters.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// True if the parameter belongs to a tail's law, whose slope is computed reading by reading.
bool is_of_tail(const Model& model, const FreeParameter& p);

/// How the law of a row's error e_i depends on what is fitted: slopes of its log density ln p(e_i) and of the error under the Gaussian
/// that stands for it, g_i = sqrt(w_i) (e_i / s_i - a_i) with weight w and shift a.
struct LawSlopes {
  Eigen::VectorXd error_in_error;  ///< d g_i / d e_i [1/m]
  /// In ln s_i where the sizes of the tails stay, and where the calibration's spread moves, which some tails are measured by.
  Eigen::VectorXd density_in_spread, error_in_spread, density_in_level, error_in_level;
  /// In the logarithm of every parameter of a tail, 0 for the others [rows x parameters].
  SerialErrors::Columns density_in_parameters, error_in_parameters;
};

/// By differences, for what joint scoring fits; the slopes of the predictions' errors only where they are not independent.
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
