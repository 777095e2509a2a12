// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal {

/// Half the width of a 95 % interval in standard deviations: the 97.5 % quantile of the normal distribution.
inline constexpr double z95 = 1.959963984540054;
/// The one-sided 95 % limit: the 95 % quantile.
inline constexpr double z95_one_sided = 1.644853626951473;
/// Half of normal errors are within so many standard deviations: the median of |N(0, 1)|.
inline constexpr double median_of_normal_size = 0.6744897501960817;
/// Radius of the 95 % region of a normal in the plane, in standard deviations: sqrt(-2 ln 0.05).
inline constexpr double radius95 = 2.447746830680816;
/// log(2 pi) / 2: what one normal reading adds to a negative log-likelihood besides log(sigma) and its
/// square.
inline constexpr double half_log_two_pi = 0.918938533204672741780;

}  // namespace rangecal
