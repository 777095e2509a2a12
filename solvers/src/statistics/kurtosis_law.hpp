// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal {

/// The normal score of the kurtosis b = n sum z^4 / (sum z^2)^2 of n independent normal z of mean 0: the score that a standard
/// normal exceeds as often as b is exceeded, Phi(score) = P(b' < b). b is a mean of fourth powers, far from normal: for 100
/// values it exceeds 3.9 standard deviations in 43 of 10 000 cases, a normal value once in 20 000.
///
///   E b = 3 n / (n + 2),   var b = 24 n^2 (n - 1) / ((n + 2)^2 (n + 4) (n + 6)),
///
/// since b is independent of sum z^2. The quantiles in these units are a table over n from 20 to 100 000 and scores of +-6.5,
/// interpolated linearly in 1 / sqrt(n) and in the score; for larger n it goes to the normal distribution at infinite n.
/// The table is printed by `benchmarks/kurtosis_table.py`: upper tails by conditioning on the largest |z|
/// (Asmussen and Kroese 2006, Advances in Applied Probability 38, 545), lower ones by exponential tilting;
/// probabilities are good to 3 % within scores of +-3, to 5 % within +-5; between the values of n in the table to 0.05 in the
/// score. Below 20 values the score is 0: nothing can be said.
///
/// Beyond +-6.5 the score gives an order and a size, but no probability. For light tails it continues as a straight line
/// down to b = 1. For heavy ones it grows as `anscombe_glynn` does: half its square is about half the gain in nats of a
/// contaminated normal, where three to ten values in a hundred have three to six times the spread. The true probability,
/// which is that of a single huge value, would give such values a much smaller score, a straight line a much larger one.
///
/// For residuals of a fit with p coefficients to N values use n = N - p. Probabilities of the upper tail are then good to 7 %,
/// from 30 values on and up to order 6; lower scores come up too seldom, for 40 values and order 2 two thirds as often as
/// they should.
double kurtosis_score(double kurtosis, double n);

/// The kurtosis transformed to a normal score by its first three moments (Anscombe and Glynn 1983, Biometrika 70, 227, by the
/// cube root of an inverse chi-square). Valid for b above its mean, where it grows with b; below there is a pole, for 100 values
/// at b = 1.4, beyond which the sign changes.
double anscombe_glynn(double kurtosis, double n);

}  // namespace rangecal
