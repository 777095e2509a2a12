// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "calibrate/landmarks_job.hpp"
#include "rangecal/solvers/joint_ml/robust.hpp"

namespace rangecal {

/// The shape as a calibration holds it, with the standard deviations of its parameters in their order (empty: none are
/// known); none for the Gaussian.
std::optional<ShapeEstimate> shape_estimate(const NoiseShapeParameters& shape,
                                            const std::vector<double>& deviations);

/// The job's answer by `full` or `marginal` with heavy tails: estimates, shapes, and both likelihoods of them at the
/// estimate (robust_nll); AIC counts the shapes' parameters too.
Calibration calibration_from_robust(const LandmarksJob& job, const RobustJointFit& fit);
Calibration calibration_from_robust(const LandmarksJob& job, const RobustMarginalFit& fit);

/// Tells what noise the report's calibrations have, and what that does to the scores of the others.
void report_shapes(CalibrationReport& report);

}  // namespace rangecal
