// SPDX-License-Identifier: BSD-3-Clause
#include "closed_form/moments.hpp"

#include <algorithm>
#include <cmath>

namespace rangecal {

double variance_from_moments(const std::vector<MomentTerm>& terms, double within, double dof) {
  if (!(dof > 0.0)) return 0.0;
  double sum = within;  // with other = 0: an upper limit of the root
  for (const MomentTerm& t : terms) sum += t.residual_sq / t.scale;
  const double high = sum / dof;
  if (!(high > 0.0) || !std::isfinite(high)) return 0.0;
  // S(x) = dof, S(x) = within / x + sum r^2 / (x scale + other). 1 / S is concave and increases, a straight line where
  // other = 0, so Newton's method on it never passes the root from the left, and one step from the right ends left of it.
  struct At {
    double value, slope;
  };
  const auto at = [&](double x) {
    At s{within / x, within / (x * x)};
    for (const MomentTerm& t : terms) {
      const double inverse = 1.0 / (x * t.scale + t.other), share = t.residual_sq * inverse;
      s.value += share;
      s.slope += share * t.scale * inverse;
    }
    return s;
  };
  const double low = 1e-10 * high;
  if (at(low).value <= dof) return 0.0;
  double x = high;
  for (int iteration = 0; iteration < 100; ++iteration) {
    const At s = at(x);
    const double next = std::max(low, x + s.value * (s.value - dof) / (dof * s.slope));
    if (std::abs(next - x) <= 1e-14 * x) return next;
    x = next;
  }
  return x;
}

double std_dev_from_moments(const std::vector<MomentTerm>& terms, double shared, double dof_within,
                            double dof, double x) {
  double slope = dof_within / x;
  for (const MomentTerm& t : terms) slope += t.scale / (x * t.scale + t.other);
  const double all = dof_within + static_cast<double>(terms.size());
  return std::sqrt(2.0 * dof + 4.0 * shared) / (slope * dof / all);
}

}  // namespace rangecal
