// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>

#include "rangecal/problems/landmarks/power_law_term.hpp"
#include "rangecal/problems/landmarks/range_term.hpp"

namespace rangecal {

/// The range term q of one cell to third order in d: its derivatives q1, q2, q3 in d, and for each parameter of the curve
/// (alpha, then tau) the first and second derivative in d of dq/dparameter.
struct ThirdOrder {
  ThirdOrder(const JointState& at, const Cells& cells)
      : state(at),
        moved(at),
        na(static_cast<int>(at.alpha.size())),
        is_power(is_power_of_f(at.noise.law)),
        has_slope(!cells.effect_slope.empty()),
        law{at.noise.power_of_f(), 1.0 / (at.noise.parameters[0] * at.noise.parameters[0])} {}

  void evaluate(double d, const Cells& c, std::size_t i) {
    if (!is_power) {
      general.evaluate(d, c, i, state.alpha, state.noise);
      q1 = general.cost.first();
      q2 = general.cost.second();
      q3 = general.cost.third();
      for (int a = 0; a < na; ++a) {
        const Taylor<3> by_alpha = general.by_alpha(a);
        first[a] = by_alpha.first();
        second[a] = by_alpha.second();
      }
      for (int e = 0; e < general.noise_parameters(); ++e) {
        const Taylor<3> by_tau = general.by_tau(e);
        first[na + e] = by_tau.first();
        second[na + e] = by_tau.second();
      }
      return;
    }
    double f = 0.0, f3 = 0.0;  // Taylor coefficients first, then derivatives
    f1 = f2 = 0.0;
    for (int a = na; a-- > 0;) {
      f3 = f3 * d + f2;
      f2 = f2 * d + f1;
      f1 = f1 * d + f;
      f = f * d + state.alpha[a];
    }
    f2 *= 2.0;
    f3 *= 6.0;
    const double mean = has_slope ? c.range_mean[i] - c.effect_change(i, d) : c.range_mean[i];
    const PowerLawTerm term(law, f, c.count[i], c.range_weight[i], mean, c.range_mean_square[i]);
    g1 = term.by_f;
    g2 = term.by_f_f;
    g3 = term.third();
    g1_tau = term.by_f_tau;
    g2_tau = term.by_f_f_tau();
    g1_slope = g2 * f1;
    g2_slope = g3 * f1;
    g1_bend = g2_slope * f1 + g2 * f2;
    g1_tau_slope = g2_tau * f1;
    q1 = g1 * f1;
    q2 = g2 * f1 * f1 + g1 * f2;
    q3 = g3 * f1 * f1 * f1 + 3.0 * g2 * f1 * f2 + g1 * f3;
    double by_tau_slope = g1_tau * f1, by_tau_bend = g2_tau * f1 * f1 + g1_tau * f2;
    if (has_slope) {  // d/dd = f1 d/df + b d/dg
      const double b = c.effect_slope[i], fg = term.by_f_g(), ffg = term.by_f_f_g(), fgg = term.by_f_g_g();
      q1 += term.by_g() * b;
      q2 += (2.0 * fg * f1 + term.by_g_g() * b) * b;
      q3 += 3.0 * (ffg * f1 * f1 + fgg * f1 * b + fg * f2) * b;
      g1_slope += fg * b;
      g2_slope += ffg * b;
      g1_bend += (2.0 * ffg * f1 + fgg * b) * b;
      g1_tau_slope += term.by_f_g_tau() * b;
      by_tau_slope += term.by_g_tau() * b;
      by_tau_bend += (2.0 * term.by_f_g_tau() * f1 + term.by_g_g_tau() * b) * b;
    }
    double power = 1.0, power_1 = 0.0, power_2 = 0.0;  // d^a and its derivatives
    for (int a = 0; a < na; ++a) {
      first[a] = power_1 * g1 + power * g1_slope;
      second[a] = power_2 * g1 + 2.0 * power_1 * g1_slope + power * g1_bend;
      power_2 = power_2 * d + 2.0 * power_1;
      power_1 = power_1 * d + power;
      power *= d;
    }
    first[na] = by_tau_slope;
    second[na] = by_tau_bend;
  }

  /// After evaluate: derivatives in d, in the rotation of n and in the curve's parameters of what the covariances with alpha
  /// add to tr(M H) of the cell,
  ///   E = 2 sum_a d2q/(dd dalpha_a) n_a + sum_ab d2q/(dalpha_a dalpha_b) M_ab,
  /// with n_a = n . cov(delta, alpha_a), t_a = t . cov(delta, alpha_a).
  struct AlphaTrace {
    double by_d = 0.0, by_turn = 0.0;
    std::array<double, 2 * RangeTerm<3>::max_coefficients> by_curve{};
  };
  void alpha_trace(double d, const Cells& c, std::size_t i, const double* n, const double* t, const double* M,
                   AlphaTrace& out) {
    out.by_turn = 0.0;
    for (int a = 0; a < na; ++a) out.by_turn += 2.0 * first[a] * t[a];
    if (!is_power) {
      differentiate_alpha_trace(d, c, i, n, M, out);
      return;
    }
    // With g1, g2, g3 the cost's derivatives in f: E = 2 (g1' m + g1 m') + g2 w,  m = sum n_a d^a,  w = sum M_ab d^a d^b.
    double power[RangeTerm<3>::max_coefficients], m = 0.0, m1 = 0.0, m2 = 0.0, w = 0.0, w1 = 0.0;
    power[0] = 1.0;
    for (int a = 1; a < na; ++a) power[a] = d * power[a - 1];
    for (int a = 0; a < na; ++a) {
      const double slope = a > 0 ? a * power[a - 1] : 0.0;
      m += n[a] * power[a];
      m1 += n[a] * slope;
      if (a > 1) m2 += n[a] * a * (a - 1) * power[a - 2];
      double row = 0.0;
      for (int b = 0; b < na; ++b) row += M[a * na + b] * power[b];
      w += power[a] * row;
      w1 += 2.0 * slope * row;
    }
    out.by_d = 2.0 * (g1_bend * m + 2.0 * g1_slope * m1 + g1 * m2) + g2_slope * w + g2 * w1;
    const double by_f = 2.0 * (g2_slope * m + g2 * m1) + g3 * w, by_slope = 2.0 * g2 * m;
    for (int a = 0; a < na; ++a)
      out.by_curve[a] = by_f * power[a] + (a > 0 ? by_slope * a * power[a - 1] : 0.0);
    out.by_curve[na] = 2.0 * (g1_tau_slope * m + g1_tau * m1) + g2_tau * w;
  }

  /// The same by central differences of E, for the laws whose derivatives are not written out. E is smooth; the relative
  /// error is of order 1e-10.
  void differentiate_alpha_trace(double d, const Cells& c, std::size_t i, const double* n, const double* M,
                                 AlphaTrace& out) {
    constexpr double part = 1e-5;
    const auto trace = [&](double at) {
      near.evaluate(at, c, i, moved.alpha, moved.noise);
      double sum = 0.0;
      for (int a = 0; a < na; ++a) {
        sum += 2.0 * near.by_alpha(a).first() * n[a];
        for (int b = 0; b < na; ++b)
          sum += near.alpha_alpha * M[a * na + b] * near.power[a].value() * near.power[b].value();
      }
      return sum;
    };
    const auto slope = [&](double& parameter, double step) {
      const double home = parameter;
      parameter = home + step;
      const double up = trace(d);
      parameter = home - step;
      const double down = trace(d);
      parameter = home;
      return (up - down) / (2.0 * step);
    };
    out.by_d = (trace(d * (1.0 + part)) - trace(d * (1.0 - part))) / (2.0 * part * d);
    double power = 1.0;
    for (int a = 0; a < na; ++a, power *= d) out.by_curve[a] = slope(moved.alpha[a], part * d / power);
    const Eigen::Index taus = moved.noise.parameters.size();
    const double spread = state.noise.spread(d, 0.0);
    power = 1.0;
    for (Eigen::Index e = 0; e < taus; ++e, power *= d) {
      double& tau = moved.noise.parameters[e];
      const bool beta = !has_sigma(state.noise.law);
      out.by_curve[na + e] = slope(tau, part * (beta ? spread / power : tau)) * (beta ? 1.0 : tau);
    }
  }

  const JointState& state;
  JointState moved;
  int na;
  bool is_power, has_slope;
  PowerLaw law;
  RangeTerm<3> general;
  RangeTerm<2> near;
  double f1 = 0.0, f2 = 0.0, g1 = 0.0, g2 = 0.0, g3 = 0.0, g1_tau = 0.0,
         g2_tau = 0.0;                                                       ///< of f in d, and of q in f
  double g1_slope = 0.0, g1_bend = 0.0, g2_slope = 0.0, g1_tau_slope = 0.0;  ///< of these in d
  double q1 = 0.0, q2 = 0.0, q3 = 0.0;
  std::array<double, 2 * RangeTerm<3>::max_coefficients> first{}, second{};
};

}  // namespace rangecal
