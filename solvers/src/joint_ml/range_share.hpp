// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/problems/landmarks/power_law_term.hpp"
#include "rangecal/problems/landmarks/range_term.hpp"

namespace rangecal {

constexpr int max_curve = 2 * RangeTerm<2>::max_coefficients;

/// One cell's range share as the loop uses it: slopes along the line of sight, and with the curve's parameters.
struct RangeShare {
  double value, along, along_along;  ///< q, dq/dd, d2q/dd2 (exact or expected)
  double cross[max_curve];           ///< d2q / dd dcurve_i
};

/// Adds the cell's share for a power law of f to gradient and Hessian (m = alpha_count + 1 square, upper triangle) of the
/// curve. The logarithm of f of single readings goes into `product`. False outside of the domain. Bent: the cells have
/// slopes of their own (Cells::effect_slope).
template <int NA, bool Bent>
bool power_law_share(const PowerLaw& law, const double* alpha, int alpha_count, double tau, double d,
                     const Cells& c, std::size_t i, bool exact, double& product, RangeShare& share,
                     double* gradient, double* hessian) {
  const int na = NA > 0 ? NA : alpha_count, m = na + 1;
  double power[max_curve], f = alpha[na - 1], slope = 0.0, bend = 0.0;
  for (int a = na - 1; a-- > 0;) {
    bend = bend * d + slope;
    slope = slope * d + f;
    f = f * d + alpha[a];
  }
  bend *= 2.0;
  if (!(d > 0.0) || (law.power > 0 && !(f > 0.0))) return false;
  const double R = c.count[i];
  const double mean = Bent ? c.range_mean[i] - c.effect_change(i, d) : c.range_mean[i],
               own = Bent ? c.effect_slope[i] : 0.0;
  const PowerLawTerm term(law, f, R, c.range_weight[i], mean, c.range_mean_square[i]);
  share.value = R * tau + 0.5 * term.chi_sq;
  if (R == 1.0)
    product *= f;  // one logarithm for many
  else if (law.power > 0)
    share.value += R * law.power * std::log(f);
  share.along = term.by_f * slope;
  const double aa = exact ? term.by_f_f : term.fisher_f_f(R);
  const double at = exact ? term.by_f_tau : term.fisher_f_tau(R);
  share.along_along = exact ? term.by_f_f * slope * slope + term.by_f * bend : aa * slope * slope;
  double along_f = aa * slope, along_tau = at * slope;  // of dq/df and dq/dtau in d
  if constexpr (Bent) {
    const double fg = exact ? term.by_f_g() : term.P;  // e = 0 is expected
    share.along += term.by_g() * own;
    share.along_along += (2.0 * fg * slope + term.by_g_g() * own) * own;
    along_f += fg * own;
    if (exact) along_tau += term.by_g_tau() * own;
  }
  power[0] = 1.0;
  for (int a = 1; a < na; ++a) power[a] = d * power[a - 1];
  for (int a = 0; a < na; ++a) {
    gradient[a] += term.by_f * power[a];
    const double scaled = aa * power[a];
    for (int e = a; e < na; ++e) hessian[a * m + e] += scaled * power[e];
    hessian[a * m + na] += at * power[a];
    share.cross[a] = power[a] * along_f + (exact && a > 0 ? a * power[a - 1] * term.by_f : 0.0);
  }
  gradient[na] += term.by_tau;
  hessian[na * m + na] += exact ? term.by_tau_tau() : 2.0 * R;
  share.cross[na] = along_tau;
  return true;
}

/// The same for any law by RangeTerm.
inline bool general_share(RangeTerm<2>& term, const JointState& state, double d, const Cells& c,
                          std::size_t i, bool exact, RangeShare& share, double* gradient, double* hessian) {
  if (!term.evaluate(d, c, i, state.alpha, state.noise)) return false;
  const int na = term.coefficients(), nt = term.noise_parameters(), m = na + nt;
  share.value = term.cost.value();
  share.along = term.cost.first();
  share.along_along = exact ? term.cost.second() : term.fisher_d_d;
  const double aa = exact ? term.alpha_alpha : term.fisher_alpha_alpha;
  const double at = exact ? term.alpha_tau : term.fisher_alpha_tau;
  const double tt = exact ? term.tau_tau : term.fisher_tau_tau;
  for (int a = 0; a < na; ++a) {
    const Taylor<2> by_alpha = term.by_alpha(a);
    const double power = term.power[a].value();
    gradient[a] += by_alpha.value();
    for (int e = a; e < na; ++e) hessian[a * m + e] += aa * power * term.power[e].value();
    for (int j = 0; j < nt; ++j) hessian[a * m + na + j] += at * power * term.tau_slope(j);
    share.cross[a] = exact ? by_alpha.first() : term.fisher_d_alpha * power;
  }
  for (int j = 0; j < nt; ++j) {
    const Taylor<2> by_tau = term.by_tau(j);
    gradient[na + j] += by_tau.value();
    for (int e = j; e < nt; ++e) hessian[(na + j) * m + na + e] += tt * term.tau_slope(j) * term.tau_slope(e);
    share.cross[na + j] = exact ? by_tau.first() : term.fisher_d_tau * term.tau_slope(j);
  }
  return true;
}

}  // namespace rangecal
