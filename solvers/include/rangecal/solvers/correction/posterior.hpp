// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <vector>

#include "rangecal/solvers/correction/effect_correction.hpp"

namespace rangecal {

/// What is known about a distance before its reading [m]. Without components: uniform over [low, high]. With components:
/// their mixture, cut to [low, high], of which the share `surprise` is uniform, so that a wrong prediction can be left.
struct DistancePrior {
  double low_m = 0.0, high_m = 0.0;  ///< both 0: the distances over which the calibration was fitted
  /// The density of N(mean, sigma^2) + U(-half_width, half_width).
  struct Component {
    double weight = 1.0, mean_m = 0.0, sigma_m = 0.0, half_width_m = 0.0;
  };
  std::vector<Component> components;  ///< weights sum to 1
  double surprise = 1e-6;

  /// Throws InputError naming the bad field and its value.
  void check() const;
};

/// A part of the distances over which f is monotone: what one root of f(d) = y stands for.
struct PosteriorRoot {
  double probability = 0.0;              ///< that the true distance lies in [from, to]
  double mean_m = 0.0, std_dev_m = 0.0;  ///< given that it does; 0 probability: NaN
  double from_m = 0.0, to_m = 0.0;       ///< ends: turning points of f, and the ends of the prior
};

struct DistancePosterior {
  /// converged; failed: no distance of [low, high] lets the reading lie within 4 standard deviations of what
  /// is read there
  Outcome outcome = Outcome::failed;
  std::string reason;
  double mode_m = 0.0, mean_m = 0.0, std_dev_m = 0.0;
  double low_m = 0.0, high_m = 0.0;  ///< 95 % interval: 2.5 % of the probability below, 2.5 % above
  std::vector<PosteriorRoot> roots;  ///< ascending in distance
  double log_evidence = 0.0;         ///< log of the integral of prior times likelihood [nats]
  bool against_prior =
      false;  ///< the mode stands on the share that is left for surprises, not on what was expected
};

/// Which distance is behind a reading y, the question that 2016 section 5.2.2 leaves open, by Bayes' rule:
///
///   p(d | y) = p(y | d) p(d) / Z,   p(y | d) = N(y; f(d), s(d)^2 + var f(d)),
///
/// var f(d) by `curve_variance` (left out where the calibration has none), effects of the calibration in f and s, and in var
/// f where it says how well they are known. The
/// turning points of f cut the distances into parts, one for each root; the probability of a root is the integral over its
/// part. Distances drawn from the prior lie in the interval, and in the parts, as often as is stated (Lindley 1982).
///
/// Integrals by 16-point Gauss-Legendre rules between the ends, turning points, crossings of f = y, and multiples of the
/// widths there; relative error about 1e-8. Throws InputError for a reading that is not finite and positive and a bad
/// prior. Cost: some 1000 evaluations of the likelihood, 50 us.
DistancePosterior distance_posterior(const EffectCorrector& corrector, double reading_m,
                                     const ReadingSetting& setting, const DistancePrior& prior = {});

/// The prior of the next distance where this was the posterior and the sensor moves at most `reach_m` along the beam
/// until then: one component per root, widened. The normal in each is the one approximation.
DistancePrior moved(const DistancePosterior& before, const DistancePrior& prior, double reach_m);

/// The posterior under one prior for any number of readings, from a table over y: linear between exact values, and exact
/// where the midpoint of two is off by more than `tolerance` standard deviations (beside turning points, where root and
/// interval jump) and in the two cells at each side of such a one. Without effects.
class PosteriorTable {
 public:
  static constexpr int max_roots = 4;
  struct Row {
    double mode_m, mean_m, std_dev_m, low_m, high_m;
    /// Of each root, its mean and standard deviation; 0 from root_count() on.
    double probability[max_roots], root_m[max_roots], root_std_dev_m[max_roots];
  };
  /// Throws InputError as distance_posterior, and for a curve with more than 4 monotone parts. Cost: 2 `nodes` posteriors.
  PosteriorTable(const Calibration& calibration, const DistancePrior& prior = {}, int nodes = 8192,
                 double tolerance = 1e-3);

  PosteriorTable(const PosteriorTable&) = delete;
  PosteriorTable& operator=(const PosteriorTable&) = delete;

  /// NaN all over for a reading that is not finite and positive, or that no distance explains. Cost: some 10
  /// ns; exact cells and readings outside the table 50 us.
  Row operator()(double reading_m) const;

  int root_count() const { return root_count_; }
  double exact_share() const;  ///< of the table's cells
  double low_reading_m() const { return low_; }
  double high_reading_m() const { return high_; }

 private:
  Row exact(double reading_m) const;

  Calibration calibration_;
  DistancePrior prior_;
  EffectCorrector corrector_;
  double low_ = 0.0, high_ = 0.0, per_m_ = 0.0;
  int root_count_ = 0;
  std::vector<Row> rows_;
  std::vector<char> direct_;
};

}  // namespace rangecal
