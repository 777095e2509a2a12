// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>
#include <limits>

namespace rangecal {

/// Information criteria of a fit with negative log-likelihood `nll` [nats] and p free parameters on N
/// readings; lower is better.
///
///   AIC  = 2 nll + 2 p                              (Akaike 1974)
///   AICc = AIC + 2 p (p + 1) / (N - p - 1)          (Hurvich and Tsai 1989); +infinity where N <= p + 1
///   BIC  = 2 nll + p log N                          (Schwarz 1978)
inline double aic(double nll, double p) { return 2.0 * nll + 2.0 * p; }

inline double aicc(double nll, double p, double N) {
  if (N <= p + 1.0) return std::numeric_limits<double>::infinity();
  return aic(nll, p) + 2.0 * p * (p + 1.0) / (N - p - 1.0);
}

inline double bic(double nll, double p, double N) { return 2.0 * nll + p * std::log(N); }

}  // namespace rangecal
