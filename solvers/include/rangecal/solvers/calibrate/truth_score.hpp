// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <span>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// A calibration against ground truth, where the recordings have any.
struct TruthScore {
  std::optional<double>
      landmark_rmse_m;  ///< sqrt(mean |m_hat - m|^2) over landmarks with truth; no alignment
  int landmarks = 0;    ///< compared
  std::optional<double>
      landmark_strain;  ///< sqrt(mean e^T C^-1 e / 2), e the error of a landmark, C its covariance: 1
                        ///< where the covariances are honest; over landmarks that have one
  std::optional<double> mse_ratio;  ///< MSE(d, y) / MSE(d, d_hat) over the readings (Alhashimi 2021, eq. 31)
  double rmse_raw_m = 0.0, rmse_corrected_m = 0.0;  ///< the two under the roots
  int readings = 0;                                 ///< compared
  bool estimated_stops = false;  ///< some true distances were taken from estimated or commanded stops
};

/// d_hat is the most likely root of f(d) = y (2021 eq. 29, 30), or the nearest distance where there is none.
/// The true distance is |m - p| - radius from truth_landmarks and truth_stops; where a stop has no truth,
/// from `stops` (a calibration with stops of the same recordings), else from the commanded pose. For pairs it
/// is true_m. Cost: one correction per reading.
TruthScore score_against_truth(std::span<const Recording> recordings, const Calibration& calibration,
                               const Calibration* stops = nullptr);

}  // namespace rangecal
