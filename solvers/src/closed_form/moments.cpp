// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/moments.hpp"

#include <cmath>

namespace rangecal {

double variance_from_moments(const std::vector<MomentTerm>& terms, double within, double dof) {
  if (!(dof > 0.0)) return 0.0;
  const auto excess = [&](double x) {
    double sum = within / x;
    for (const MomentTerm& t : terms) sum += t.residual_sq / (x * t.scale + t.other);
    return sum - dof;
  };
  double sum = within;  // with other = 0: an upper limit of the root
  for (const MomentTerm& t : terms) sum += t.residual_sq / t.scale;
  double high = sum / dof;
  if (!(high > 0.0) || !std::isfinite(high)) return 0.0;
  if (excess(high) >= -1e-12 * dof) return high;  // nothing else contributes
  double low = 1e-10 * high;
  if (excess(low) <= 0.0) return 0.0;
  while (high > low * (1.0 + 1e-13)) {
    const double middle = std::sqrt(low * high);
    if (middle <= low || middle >= high) break;
    (excess(middle) > 0.0 ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

}  // namespace rangecal
