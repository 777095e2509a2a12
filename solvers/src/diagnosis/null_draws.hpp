// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <vector>

#include "diagnosis/scalar_tests.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal::diagnosis {

/// Leverage-corrected variance units of a channel, first the within units of all cells, then the between
/// units: z^2 and its degrees of freedom.
struct VarianceUnits {
  Eigen::VectorXd square, dof;
};

/// What the battery's questions see of one recording of the fitted model.
struct NullDraw {
  Eigen::VectorXd cells;                         ///< errors of the cell means, (range [m], bearing [rad])
  Eigen::VectorXd range_rows, bearing_rows;      ///< deviations from them [m], [rad]; empty if not wanted
  Eigen::VectorXd range_excess, bearing_excess;  ///< square - dof of the variance units
  std::vector<ScalarTest> scalars;               ///< empty where rows are not drawn
};

/// Recordings of the fitted model, to first order: errors of readings, of stops from their prior and of a
/// simulation's curve from its covariance; what the calibration absorbs of them is taken out where residuals
/// are judged, and the spread of each channel is estimated anew from what is left, as it was for the
/// recording.
class NullDraws {
 public:
  /// `wants_rows`: questions look within cells. Else rows are drawn up to `most_rows` readings only; beyond,
  /// variances are drawn cell by cell, and there are no scalars.
  NullDraws(const Rows& rows, const Projector& projector, const JointProblem& problem,
            const ScalarTests& scalars, const VarianceUnits& range, const VarianceUnits& bearing,
            bool wants_rows);

  NullDraw draw(Random& random) const;

 private:
  /// What does not change from draw to draw: of one row, one over the standard deviation.
  struct Channel {
    const VarianceUnits& units;
    Eigen::VectorXd row_scale;
  };
  /// Residuals of one channel in units of its spread, which is estimated from them: `scale` times what was
  /// drawn with.
  struct Settled {
    double scale = 1.0;
    Eigen::VectorXd cells, rows, excess;
  };
  Eigen::VectorXd draw_cells(Random& random) const;
  /// `cells`: of the cell means, in units of their spread.
  Settled settle(const Channel& channel, Eigen::VectorXd cells, Random& random) const;

  const Rows& rows_;
  const Projector& projector_;
  const JointProblem& problem_;
  const ScalarTests& scalars_;
  Channel range_, bearing_;
  bool has_rows_;
};

}  // namespace rangecal::diagnosis
