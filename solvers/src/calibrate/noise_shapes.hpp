// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include "calibrate/landmarks_job.hpp"
#include "rangecal/solvers/robust/robust.hpp"

namespace rangecal {

/// The job's answer by `full` or `marginal` with heavy tails: estimates, shapes, and the joint and marginal likelihood with
/// these shapes at the estimate (robust_nll); AIC counts the shapes' parameters too.
Calibration calibration_from_robust(const LandmarksJob& job, const RobustJointFit& fit);
Calibration calibration_from_robust(const LandmarksJob& job, const RobustMarginalFit& fit);

/// Counts the readings that are outliers under the shapes, and lists the largest with what each most likely is:
///   label     range and bearing both agree within 4 spreads with another landmark of the recording;
///   late or early echo   the range alone is off;
///   grazing   the bearing is off by the landmark's radius, as when a beam hits its edge;
///   bearing   anything else.
void list_outliers(const LandmarksJob& job, const RobustMarginalFit& fit, Calibration& calibration);

/// The same for pairs: residuals in the order of the recordings' readings, and the recording and row of each.
struct PlacedReading {
  int recording = 0, row = 0;
};
void list_outliers(const std::vector<double>& z, const std::vector<double>& outlier,
                   const std::vector<PlacedReading>& places, Calibration& calibration);

/// "contaminated (student-t +147.3, gaussian +250.3)": the shape kept, and how far the AIC of the others is above the lowest.
std::string tried_in_words(NoiseShape kept, const std::vector<std::pair<NoiseShape, double>>& tried);

/// Adds notes on the noise shapes of the report's calibrations, and on what they mean for the scores of the others.
void report_shapes(CalibrationReport& report);

}  // namespace rangecal
