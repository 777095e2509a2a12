// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// What the user reads, from what the search found.
Diagnosis assemble_report(const Rows& rows, std::span<const Recording> recordings, const SearchResult& found);

/// Parameters of all effects of a fit as the user reads them, with 95 % intervals by the delta method.
std::vector<EffectEstimate> effect_estimates(const Rows& rows, const Fit& fit);

/// A calibration (seed model's or corrected) from a fit.
Calibration calibration_of(const Rows& rows, std::span<const Recording> recordings, const Fit& fit);

/// The smooth model of an unexplained mismatch: the free curve of the first finding, as readings' changes.
struct GenericCurve {
  std::vector<double> knots, values, std_dev;  ///< covariate, change of the reading [m] or [rad]
  double gain = 0.0;                           ///< nats
  Eigen::VectorXd row_change;                  ///< per row, in the finding's channel
};

}  // namespace rangecal::diagnosis
