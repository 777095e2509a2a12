// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal::fleet {

/// The normal score of a kurtosis b = n sum z^4 / (sum z^2)^2 of n independent normal z of mean 0, the score
/// that is exceeded as often as b: Phi(score) = P(b' < b). b is a mean of fourth powers, far from normal: of
/// 100 values 3.9 standard deviations are exceeded by 43 in 10 000, of a normal value once in 20 000.
///
///   E b = 3 n / (n + 2),   var b = 24 n^2 (n - 1) / ((n + 2)^2 (n + 4) (n + 6)),
///
/// since b does not depend on sum z^2. The quantiles in these units are a table over n from 20 to 100 000 and
/// scores of +-6.5, linear in 1 / sqrt(n) and in the score; beyond, the normal law is met at n without end,
/// and a score is drawn on in a straight line, for the order of things alone. The table is printed by
/// `benchmarks/kurtosis_table.py`: upper tails by conditioning on the largest |z| (Asmussen and Kroese 2006,
/// Advances in Applied Probability 38, 545), lower ones by exponential tilting; probabilities to 3 % within
/// scores of +-3, to 5 % within +-5; between the counts of the table to 0.05 in the score. 0 below 20 values:
/// nothing can be said.
///
/// Residuals of a fit with p coefficients to N values: n = N - p. Then upper tails hold to 7 %, from 30
/// values on and up to order 6; lower ones are stated too seldom, at 40 values and order 2 two thirds as
/// often.
double kurtosis_score(double kurtosis, double n);

}  // namespace rangecal::fleet
