// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <span>
#include <utility>
#include <vector>

#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// Standardised residuals z_i = (y_i - f_i) / s_i of one channel, and the spreads s_i [m; rad].
struct ChannelResiduals {
  std::vector<double> z, s;
  std::vector<double> weight;  ///< readings that one stands for; empty: one each

  double weight_of(std::size_t i) const { return weight.empty() ? 1.0 : weight[i]; }
  double count() const;  ///< N, readings

  /// The spread that stands for all, their median: what outlier_mean is compared with.
  double typical_spread() const;
};

/// Errors of readings y at distances d [m] about a curve, in its spreads; not finite, or of a spread that is not positive,
/// outside of the curve's domain.
ChannelResiduals residuals_about(const Calibration& curve, std::span<const double> d,
                                 std::span<const double> y);

/// The noise shape that goes with residuals whose fit is held.
struct ResidualShape {
  NoiseShapeParameters shape;
  double scale = 1.0;     ///< c: the spreads are c s_i
  double location = 0.0;  ///< delta, of z; 0 unless it was free
  double nll = 0.0;       ///< the minimum below [nats]
};

/// How fit_residual_shape goes about it.
struct ResidualShapeOptions {
  /// Parameters that sigma allows for, N - sum w z^2 at the present sigmas (REML); 0 for the maximum likelihood.
  double fitted = 0.0;
  bool free_location = false;
  double tolerance = 1e-7;  ///< on the gain that is left [nats]
};

/// Minimises over scale c, shape and, where asked, location delta
///
///   (N - q) log c - sum_i log rho((z_i - delta) / c; c s_i) + [Student's t: q / 2 log((nu + 1) / (nu + 3))],
///
/// q = `fitted`: the likelihood of one channel with its curve held, REML's part of the scale and of nu in it. By
/// damped Newton steps from `start`, with the outer product of the scores (Berndt, Hall, Hall, Hausman 1974) in place of
/// the Hessian where that is not positive definite. Shapes at the
/// end of their range stay there. Cost: linear in the residuals, some 10 passes.
ResidualShape fit_residual_shape(const ChannelResiduals& residuals, const ResidualShape& start,
                                 const ResidualShapeOptions& options = {});

/// Where fit_residual_shape starts when nothing is known: scale from the median of |z|, share and size of the outliers
/// from what lies beyond 3.5 of that, their side (one-sided) from where more of it lies.
ResidualShape first_residual_shape(const ChannelResiduals& residuals, NoiseShape shape);

/// The shapes that a channel may have and their AIC less the Gaussian's, location free, lowest first. The Gaussian is
/// always among them, with 0.
using RankedShapes = std::vector<std::pair<ResidualShape, double>>;
RankedShapes rank_shapes(const ChannelResiduals& residuals, std::span<const NoiseShape> shapes);

/// How far below the Gaussian's the AIC of another shape has to lie: clean readings, by chance, would have a tail of
/// their own in one channel of eight without it; of outliers that matter it costs nothing.
inline constexpr double shape_margin_aic = 4.0;
/// The same where readings are looked at again and again as they come.
inline constexpr double stream_margin_aic = 9.0;

/// False where no shape can gain that much on the Gaussian: no excess of fourth moment, no skew and no reading beyond what
/// so many normal ones hold. A look at three sums, for data that are mostly clean.
bool may_have_outliers(const ChannelResiduals& residuals);

/// The shapes that `automatic` chooses from.
std::span<const NoiseShape> range_shapes();    ///< gaussian, student-t, contaminated, one-sided
std::span<const NoiseShape> bearing_shapes();  ///< gaussian, student-t, contaminated

}  // namespace rangecal
