// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal {

/// The normal score of a kurtosis b = n sum z^4 / (sum z^2)^2 of n independent normal z of mean 0, the score
/// that is exceeded as often as b: Phi(score) = P(b' < b). b is a mean of fourth powers, far from normal: of
/// 100 values 3.9 standard deviations are exceeded by 43 in 10 000, of a normal value once in 20 000.
///
///   E b = 3 n / (n + 2),   var b = 24 n^2 (n - 1) / ((n + 2)^2 (n + 4) (n + 6)),
///
/// since b does not depend on sum z^2. The quantiles in these units are a table over n from 20 to 100 000 and
/// scores of +-6.5, linear in 1 / sqrt(n) and in the score; beyond, the normal law is met at n without end.
/// The table is printed by `benchmarks/kurtosis_table.py`: upper tails by conditioning on the largest |z|
/// (Asmussen and Kroese 2006, Advances in Applied Probability 38, 545), lower ones by exponential tilting;
/// probabilities to 3 % within scores of +-3, to 5 % within +-5; between the counts of the table to 0.05 in the
/// score. 0 below 20 values: nothing can be said.
///
/// Beyond +-6.5 the score tells an order, and a size, but no probability. Light tails go on in a straight line
/// down to b = 1. Heavy ones grow as `anscombe_glynn` does, whose half square is about half of what a contaminated
/// normal gains in nats where three to ten values in a hundred have three to six times the spread. The probability
/// itself, that of a single huge value, would say far less of such values, a straight line far more.
///
/// Residuals of a fit with p coefficients to N values: n = N - p. Then upper tails hold to 7 %, from 30
/// values on and up to order 6; lower ones are stated too seldom, at 40 values and order 2 two thirds as
/// often.
double kurtosis_score(double kurtosis, double n);

/// The kurtosis turned normal by its first three moments (Anscombe and Glynn 1983, Biometrika 70, 227, as if by the
/// cube root of an inverse chi-square). For b above its mean, where it grows with b; below there is a pole,
/// at b = 1.4 of 100 values, beyond which it changes its sign.
double anscombe_glynn(double kurtosis, double n);

}  // namespace rangecal
