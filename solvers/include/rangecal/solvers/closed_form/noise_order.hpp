// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/outcome.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// What the sum of squared successive differences of a batch is divided by.
enum class DifferenceDivisor {
  unbiased,  ///< 2 (|B_b| - 1): there are |B_b| - 1 differences; the default
  printed    ///< 2 |B_b|, as 2016 eq. 14 prints it: low by (|B_b| - 1) / |B_b|
};

/// One hypothesis H_s: y = f + f^s e, e ~ N(0, sigma_e^2)  (Alhashimi 2016, eq. 10).
struct NoiseOrderHypothesis {
  int power = 0;                ///< s
  double sigma_e_sq = 0.0;      ///< eq. 14 [m^(2 - 2 s)]
  double log_likelihood = 0.0;  ///< eq. 15 [nats], constants included
};

struct NoiseOrder {
  Outcome outcome =
      Outcome::failed;  ///< converged; too_few_data; failed (a batch mean or all spreads not positive)
  std::string reason;
  std::vector<double> batch_mean_m;                ///< eq. 13, per batch used
  std::vector<int> batch_size;                     ///< |B_b|, per batch used
  int left_out = 0;                                ///< batches of fewer than 2 readings
  std::array<NoiseOrderHypothesis, 4> hypotheses;  ///< H0 .. H3
  int best_power = -1;                             ///< of the highest log-likelihood
};

/// Which power of f the noise grows with, from batches of readings [m], each at one fixed unknown distance,
/// in order of time (2016 eq. 10-16):
///   f_b       = mean of y over batch b                                                       (13)
///   sigma_e^2 = (1/B) sum_b 1 / (2 (|B_b| - 1)) sum_k ((y_k - y_{k-1}) / f_b^s)^2            (12, 14)
///   log p     = -1/2 sum_b [ |B_b| log(2 pi v_b) + sum_k (y_k - f_b)^2 / v_b ],  v_b = f_b^(2s) sigma_e^2
///   (15)
/// The print of (15) leaves out the factor 1/2 and the constant N/2 log 2 pi; neither changes which is best.
/// Needs at least 2 batches of 2 readings; with all batches at one distance the hypotheses cannot be told
/// apart. Throws InputError if a reading is not finite. Cost: linear in the readings.
NoiseOrder noise_order(std::span<const std::vector<double>> batches,
                       DifferenceDivisor divisor = DifferenceDivisor::unbiased);

/// The same from a recording of kind pairs with a column `batch`; readings without a batch are not used.
NoiseOrder noise_order(const Pairs& pairs, DifferenceDivisor divisor = DifferenceDivisor::unbiased);

/// The batches of a recording of kind pairs, in the order of their labels, readings in the order of the file.
std::vector<std::vector<double>> batches_of(const Pairs& pairs);

/// (y_k - y_{k-1}) / f^s for the readings of one batch at f = f(d) (2016 eq. 16): iid whatever the distance
/// under the right s. Empty for fewer than 2 readings.
std::vector<double> normalised_differences(std::span<const double> readings, double f, int power);

}  // namespace rangecal
