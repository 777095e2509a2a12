// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstddef>
#include <limits>

#include "rangecal/core/random.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// A share of readings has an extra error: even about 0, or on one side, where it is exponential and may end.
struct Contamination {
  double share = 0.0;
  double extra_sigma_m = 0.0;  ///< standard deviation of an even, normal one
  double mean_m = 0.0;         ///< of a one-sided one that has no end: > 0 late, < 0 early; 0: it is even
  double end_m = std::numeric_limits<double>::infinity();  ///< the largest size of a one-sided one
};

/// What is known of a share's extra error, given z.
struct ExtraError {
  double odds = 1.0;    ///< density of z with it over that without
  double weight = 1.0;  ///< the precision that is left, in units of 1 / s^2
  double mean = 0.0, variance = 0.0;
};

/// The law of a reading's error e with standard deviation s, when shares p_k of the readings have extra errors x_k:
///
///   p(e) = (1 - P) N(e; 0, s^2) + sum_k w_k p_k(e)
///   even:       p_k = N(e; 0, s^2 + sigma_k^2)
///   one-sided:  p_k = law of s N(0, 1) +- x,  x of density exp(-x / tau_k) / tau_k / (1 - exp(-end_k / tau_k)), 0 < x < end_k
///
/// A reading is of one share or of none: w_k : (1 - P) = p_k : (1 - p_k), so that w = p for a single one.
class TailLaw {
 public:
  static constexpr std::size_t most = 4;  ///< shares; further ones are not taken

  /// Slopes of the log density of e in each share, and in its size: extra_sigma_m of an even one, mean_m of one on one side; and
  /// minus its second derivative in z = e / s.
  struct Slopes {
    std::array<double, most> in_share{}, in_size{};
    double curvature = 0.0;
  };

  /// False if it adds nothing: a share of 0, or one too many.
  bool add(const Contamination& part);
  /// Another size of share k, which stays as large.
  void resize(std::size_t k, const Contamination& part) { parts_[k].law = part; }
  bool empty() const { return count_ == 0; }
  /// log density of z = e / s, and the Gaussian that stands for it (expectation and maximisation), as in log_density().
  LogDensity density(double e_m, double s_m, Slopes* slopes = nullptr) const;
  /// The normal quantile of the error's probability: standard normal where the law is right.
  double normal_score(double e_m, double s_m) const;
  /// Twice what the normal law of the same mean and variance loses of a reading's expected log density [nats].
  double negentropy(double s_m) const;
  /// Mean of the extra error [m]: of a one-sided part tau - end / (exp(end / tau) - 1), to its side.
  double mean() const;
  /// Extra error of one reading [m].
  double draw(Random& random) const;

 private:
  struct Part {
    Contamination law;
    double odds = 0.0, log_odds = 0.0;
  };
  /// density() where the odds may leave the numbers: by their logarithms.
  LogDensity density_far_out(double z, double s, Slopes* slopes) const;
  /// From the log density, and the probabilities of the body and of each share given z.
  LogDensity mixed(double z, double s, double value, double body_given_z,
                   const std::array<ExtraError, most>& extras, const std::array<double, most>& share,
                   Slopes* slopes) const;
  double body() const { return 1.0 / (1.0 + odds_); }

  std::array<Part, most> parts_{};
  std::size_t count_ = 0;
  double odds_ = 0.0;      ///< sum of p / (1 - p)
  double log_body_ = 0.0;  ///< ln (1 - P)
};

}  // namespace rangecal
