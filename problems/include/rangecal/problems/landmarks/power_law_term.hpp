// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cmath>

namespace rangecal {

/// RangeTerm for the laws s = sigma f^p, p = 0..3, written out: one cell's cost as a function of f [m] and tau = log
/// sigma alone. The chain rule through f(d) = sum alpha_i d^i is the caller's.
///
/// Cost:     q = R (tau + p log f) + chi_sq / 2,  chi_sq = P (e^2 + S^2),  P = W / (sigma^2 f^(2p)),  e = y_bar - f [nats]
/// With B = dq/dtau = R - chi_sq:   dq/df = -P e + p B / f,   dP/df = -2 p P / f,   dB/df = 2 p chi_sq / f + 2 P e.
/// A cell with an effect slope reads y = f + g + s e, g = b (d - d_0) its own: the cost is one of f and g, with e = y_bar - f - g.
/// Source:   Alhashimi 2016 eq. 17, 18, for cells; see range_term.hpp.
struct PowerLaw {
  int power = 0;           ///< p
  double precision = 1.0;  ///< 1 / sigma^2
};

struct PowerLawTerm {
  /// f > 0 wherever p > 0. mean: y_bar - g.
  PowerLawTerm(const PowerLaw& law, double f, double count, double weight, double mean, double mean_square) {
    p = law.power;
    inverse_f = p > 0.0 ? 1.0 / f : 0.0;
    double information = law.precision;
    const double inverse_sq = inverse_f * inverse_f;
    for (int i = 0; i < law.power; ++i) information *= inverse_sq;
    P = weight * information;
    e = mean - f;
    chi_sq = P * (e * e + mean_square);
    by_tau = count - chi_sq;
    by_f = p * by_tau * inverse_f - P * e;
    by_f_tau = 2.0 * (p * chi_sq * inverse_f + P * e);
    by_f_f = P + (4.0 * p * P * e + p * (2.0 * p * chi_sq - by_tau) * inverse_f) * inverse_f;
  }

  /// d3q / df3 and d3q / df2 dtau
  double third() const {
    const double P1 = -2.0 * p * P * inverse_f, chi1 = -by_f_tau;
    return P1 + inverse_f * (4.0 * p * (P1 * e - P - P * e * inverse_f) +
                             inverse_f * (2.0 * p * p * chi1 - p * by_f_tau -
                                          2.0 * p * (2.0 * p * chi_sq - by_tau) * inverse_f));
  }
  double by_f_f_tau() const {
    const double P1 = -2.0 * p * P * inverse_f;
    return 2.0 * (p * inverse_f * (-by_f_tau - chi_sq * inverse_f) + P1 * e - P);
  }
  /// Derivatives in g, and mixed ones.
  double by_g() const { return -P * e; }
  double by_g_g() const { return P; }
  double by_f_g() const { return P + 2.0 * p * P * e * inverse_f; }
  double by_f_f_g() const { return -2.0 * p * P * inverse_f * (2.0 + (2.0 * p + 1.0) * e * inverse_f); }
  double by_f_g_g() const { return -2.0 * p * P * inverse_f; }
  double by_g_tau() const { return 2.0 * P * e; }
  double by_f_g_tau() const { return -2.0 * by_f_g(); }
  double by_g_g_tau() const { return -2.0 * P; }
  /// d2q / dtau2, and the expected information in (f, f), (f, tau) = 2 R p / f, (tau, tau) = 2 R.
  double by_tau_tau() const { return 2.0 * chi_sq; }
  double fisher_f_f(double count) const { return P + 2.0 * count * p * p * inverse_f * inverse_f; }
  double fisher_f_tau(double count) const { return 2.0 * count * p * inverse_f; }

  double p, inverse_f, P, e, chi_sq;
  double by_f, by_f_f, by_f_tau, by_tau;
};

}  // namespace rangecal
