// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "rangecal/core/quantiles.hpp"
#include "rangecal/solvers/correction/posterior.hpp"

namespace rangecal {

inline constexpr int gauss_nodes = 16;

/// Nodes in [-1, 1] and weights of the rule, in the order of the nodes.
struct GaussRule {
  std::array<double, gauss_nodes> x, w;
  GaussRule();
};
inline const GaussRule gauss_rule;

/// Prior times likelihood of one reading.
class ReadingDensity {
 public:
  ReadingDensity(const EffectCorrector& corrector, double y, const ReadingSetting& setting,
                 const DistancePrior& prior)
      : corrector_(corrector), y_(y), setting_(setting), prior_(prior) {}

  double mean(double d) const { return corrector_.at(d, setting_).mean_m; }
  double spread(double d) const { return corrector_.at(d, setting_).spread_m; }
  double log_at(double d) const {
    const EffectCorrector::Expected expected = corrector_.at(d, setting_);
    if (!(expected.spread_m > 0.0)) return -std::numeric_limits<double>::infinity();
    const double z = (y_ - expected.mean_m) / expected.spread_m;
    return -0.5 * z * z - std::log(expected.spread_m) - half_log_two_pi + log_prior(d);
  }
  /// Standard deviations between the reading and what is read at d.
  double off(double d) const {
    const EffectCorrector::Expected expected = corrector_.at(d, setting_);
    return expected.spread_m > 0.0 ? std::abs(y_ - expected.mean_m) / expected.spread_m
                                   : std::numeric_limits<double>::infinity();
  }
  /// At d the prior's components, of what they give to the range at all, give less than the share that is left for surprises.
  bool is_surprise(double d) const;
  double log_prior(double d) const;
  double y() const { return y_; }

 private:
  const EffectCorrector& corrector_;
  double y_;
  const ReadingSetting& setting_;
  const DistancePrior& prior_;
};

/// A part of the distances, and the integral over it.
struct Panel {
  double from, to, mass = 0.0;
};

/// Ends of the panels, ascending: fine wherever the density may be narrow.
std::vector<double> panel_ends(const ReadingDensity& density, const DistancePrior& prior,
                               const std::vector<double>& turning_points);

/// Where `mass` is reached, panels of the given masses: integrals of the density over e^shift.
double distance_at_mass(const ReadingDensity& density, double shift, const std::vector<Panel>& panels,
                        double mass);

/// The maximum of the density between a and b, where it has one.
double mode_between(const ReadingDensity& density, double a, double b);

}  // namespace rangecal
