// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal {

// Tails and quantiles of the usual laws, by Boost.Math, whose headers are read here once and for all. A
// probability outside [0, 1], or degrees of freedom that are not positive, throw std::domain_error; a
// quantile at 0 or 1 throws std::overflow_error where the law has no end.

/// P(Z <= z) of the standard normal, by std::erfc: exact far into the lower tail.
double normal_below(double z);
/// P(|Z| > |z|) of the standard normal, the p-value of a score of either sign: exact far into the tails.
double normal_two_sided(double z);
/// z with P(Z <= z) = p, p in (0, 1), of the standard normal.
double normal_quantile(double p);
/// z with P(Z > z) = q, q in (0, 1): exact to the smallest q, where 1 - q is not.
double normal_upper_quantile(double q);

/// P(X > x) of a chi-squared with `degrees` of freedom, x >= 0.
double chi_squared_upper(double x, double degrees);
/// x with P(X <= x) = p, p in [0, 1).
double chi_squared_quantile(double p, double degrees);
/// x with P(X > x) = q, q in (0, 1].
double chi_squared_upper_quantile(double q, double degrees);

/// t with P(T <= t) = p, p in (0, 1), of a Student t with `degrees` of freedom.
double student_t_quantile(double p, double degrees);

/// ln Gamma(x), x > 0; unlike std::lgamma, which writes the sign to a variable of the process, it may be called by several threads.
double log_gamma(double x);

/// P(X > x) of Fisher's F with so many degrees of freedom above and below the line, x >= 0.
double fisher_f_upper(double x, double numerator, double denominator);

}  // namespace rangecal
