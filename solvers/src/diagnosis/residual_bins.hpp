// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "diagnosis/search.hpp"

namespace rangecal::diagnosis {

/// Residuals of every row and their variances as modelled.
struct RowResiduals {
  Eigen::ArrayXd range, bearing;                    ///< effects undone [m], [rad]
  Eigen::ArrayXd range_variance, bearing_variance;  ///< of one reading [m^2], [rad^2]
};
RowResiduals row_residuals(const Rows& rows, const Model& model, const JointState& state);

/// A covariate of docs/formats.md for every row, NaN where a field is empty; nothing where the rows have no such one.
std::optional<Eigen::VectorXd> covariate_values(const Rows& rows, const CellGeometry& geometry,
                                                const std::string& name);

/// Bin of every value, -1 where it is not finite: 12 bins of equal shares, or one for each value where there are few.
std::vector<int> bins_of(const Eigen::VectorXd& values);

/// Fills Finding::residuals of a diagnosis: the readings' residuals in the finding's channel, averaged over
/// 12 bins of equal shares along its covariate (one bin per group where it has few values), under the
/// baseline and under the final model: mean residual [m] or [rad], or for a noise channel the log ratio of
/// its variance to the modelled one. `completed`: the fit that is shown for `unexplained`; null if there
/// is none. Channels without a covariate (labels, grids, detection, stops) get no bins. Cost: n log n in the
/// readings, per finding.
void add_residual_bins(const Rows& rows, const SearchResult& found, const Fit* completed, Diagnosis& result);

}  // namespace rangecal::diagnosis
