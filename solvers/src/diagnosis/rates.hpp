// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <vector>

namespace rangecal::diagnosis {

/// What a p-value of one question is worth among all that were asked.
///
/// Questions come in families: one effect of the catalogue at all points of its grid, or all shapes of one
/// channel along one covariate. Within a family of n_f effectively independent questions, and over F
/// effectively independent families,
///   p_f = 1 - (1 - p)^n_f,   p_corrected = 1 - (1 - p_f)^F.
/// Every family has the same share of the alarm rate, so that a period tried at five hundred places takes no
/// power from an offset. n_f and F come from simulating the smallest p-values under the model (Westfall and
/// Young 1993), at the point of their law that 3 % lie beyond. Short of it the simulated law itself is the
/// corrected p-value, r / B for r of B draws, with the standard error of that point on the safe side,
/// (r + min(sqrt(r), 0.03 B / sqrt(r))) / B.
struct Rates {
  static constexpr double tail = 0.03;   ///< the point of the smallest p-value's law that fixes n_f and F
  std::map<std::string, double> within;  ///< n_f; 1 for a family that was not simulated
  double families = 100.0;               ///< F
  std::vector<double> smallest;          ///< ln of the smallest p_f of every draw, ascending; may be empty
  struct Law {
    double mean = 0.0, std_dev = 1.0;
  };
  std::map<std::string, Law> scalars;  ///< simulated laws of the scalar tests, by channel and shape

  /// z of a scalar test ("range_tail skew") by its simulated law, or as it is.
  double standardised(const std::string& test, double z) const;

  double starts(const std::string& family) const;
  /// ln p_f from the natural log of a question's p-value.
  double in_family(const std::string& family, double log_p) const;
  /// p-value corrected for everything that was asked.
  double corrected(const std::string& family, double log_p) const {
    return corrected(in_family(family, log_p));
  }
  /// The same from ln p_f.
  double corrected(double log_p_f) const;
  /// Its natural logarithm, which does not underflow.
  double log_corrected(double log_p_f) const;
  /// Questions that one of this family stands against: n_f F.
  double questions(const std::string& family) const { return starts(family) * families; }
};

/// ln(1 - (1 - p)^n), finite far into the tail.
double log_of_smallest(double log_p, double n);

}  // namespace rangecal::diagnosis
