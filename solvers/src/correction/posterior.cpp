// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/posterior.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "correction/reading_density.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

/// The density at the nodes of every panel.
struct SampledDensity {
  std::vector<Panel> panels;
  std::vector<double> log_values;                           ///< of the panels' nodes in turn
  double shift = -std::numeric_limits<double>::infinity();  ///< the largest of them
  std::size_t best = 0;                                     ///< where it stands

  SampledDensity(const ReadingDensity& density, const std::vector<double>& ends) {
    for (std::size_t i = 1; i < ends.size(); ++i) {
      panels.push_back({ends[i - 1], ends[i]});
      const double centre = 0.5 * (ends[i - 1] + ends[i]), half = 0.5 * (ends[i] - ends[i - 1]);
      for (int k = 0; k < gauss_nodes; ++k) {
        log_values.push_back(density.log_at(centre + half * gauss_rule.x[k]));
        if (log_values.back() > shift) {
          shift = log_values.back();
          best = log_values.size() - 1;
        }
      }
    }
  }
  /// Distance of the k-th node [m].
  double node(std::size_t k) const {
    const Panel& p = panels[k / gauss_nodes];
    return 0.5 * (p.from + p.to) + 0.5 * (p.to - p.from) * gauss_rule.x[k % gauss_nodes];
  }
};

/// Integrals of the density, and of it times a distance and its square.
struct PartMoments {
  double mass = 0.0, first = 0.0, second = 0.0;
  void add(double w, double d) {
    mass += w;
    first += w * d;
    second += w * d * d;
  }
  /// NaN where the mass is 0.
  double deviation() const {
    if (!(mass > 0.0)) return std::numeric_limits<double>::quiet_NaN();
    return std::sqrt(std::max(0.0, second / mass - std::pow(first / mass, 2)));
  }
};

/// Of each part between turning points, of distances from `origin`; fills the panels' masses.
std::vector<PartMoments> moments_of_parts(SampledDensity& sampled, const std::vector<double>& turning_points,
                                          double high_m, double origin) {
  std::vector<PartMoments> parts(turning_points.size() + 1);
  std::size_t part = 0;
  for (std::size_t i = 0; i < sampled.panels.size(); ++i) {
    Panel& panel = sampled.panels[i];
    while (part < turning_points.size() && panel.from >= turning_points[part] - 1e-12 * high_m) ++part;
    for (int k = 0; k < gauss_nodes; ++k) {
      const double w = gauss_rule.w[k] * 0.5 * (panel.to - panel.from) *
                       std::exp(sampled.log_values[i * gauss_nodes + k] - sampled.shift);
      panel.mass += w;
      parts[part].add(w, sampled.node(i * gauss_nodes + k) - origin);
    }
  }
  return parts;
}

/// The prior where it is given, else uniform over the distances of the calibration.
DistancePrior filled_in(const DistancePrior& given, const Calibration& calibration) {
  given.check();
  DistancePrior prior = given;
  if (prior.high_m == 0.0) {
    prior.low_m = calibration.range_min_m;
    prior.high_m = calibration.range_max_m;
  }
  if (!(prior.high_m > prior.low_m))
    throw InputError("distance_posterior: the calibration's range_m is empty and the prior gives none");
  return prior;
}

/// Why the reading has no distance; empty where it has.
std::string why_none(const ReadingDensity& density, const std::vector<double>& ends, double shift,
                     const DistancePrior& prior) {
  if (!std::isfinite(shift)) return "the likelihood is 0 at every distance of the prior";
  double off = std::numeric_limits<double>::infinity();
  for (const double d : ends) off = std::min(off, density.off(d));
  if (!(off > farthest_off)) return {};
  return fmt::format(
      "the reading is {:.0f} standard deviations off at every distance of the prior, {} to {} m", off,
      prior.low_m, prior.high_m);
}

}  // namespace

void DistancePrior::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("prior of the distance: " + what); };
  if (!(low_m >= 0.0 && std::isfinite(high_m) && (high_m > low_m || (low_m == 0.0 && high_m == 0.0))))
    refuse(fmt::format("low_m = {}, high_m = {}: not 0 <= low < high", low_m, high_m));
  if (!(surprise >= 0.0 && surprise <= 1.0)) refuse(fmt::format("surprise = {} is no share", surprise));
  for (const Component& c : components) {
    if (!std::isfinite(c.mean_m) || !(c.sigma_m >= 0.0) || !(c.half_width_m >= 0.0) ||
        !(c.sigma_m + c.half_width_m > 0.0) || !std::isfinite(c.sigma_m + c.half_width_m))
      refuse(fmt::format("a component of mean {} m, sigma {} m, half width {} m", c.mean_m, c.sigma_m,
                         c.half_width_m));
    if (!(c.weight >= 0.0 && c.weight <= 1.0 + 1e-12))
      refuse(fmt::format("a component of weight {}", c.weight));
  }
}

DistancePosterior distance_posterior(const EffectCorrector& corrector, double reading_m,
                                     const ReadingSetting& setting, const DistancePrior& given) {
  if (!(reading_m > 0.0) || !std::isfinite(reading_m))
    throw InputError(fmt::format("distance_posterior: reading {} is not a positive number", reading_m));
  const DistancePrior prior = filled_in(given, corrector.calibration());
  const std::vector<double> turning_points =
      corrector.turning_points(prior.low_m, prior.high_m, reading_m, setting);
  const ReadingDensity density(corrector, reading_m, setting, prior);
  const std::vector<double> ends = panel_ends(density, prior, turning_points);
  SampledDensity sampled(density, ends);
  DistancePosterior result;
  result.reason = why_none(density, ends, sampled.shift, prior);
  if (!result.reason.empty()) return result;

  const double origin =
      sampled.node(sampled.best);  // moments about it: of the likeliest part nothing cancels
  const std::vector<PartMoments> parts = moments_of_parts(sampled, turning_points, prior.high_m, origin);
  PartMoments all;
  for (const PartMoments& p : parts) {
    all.mass += p.mass;
    all.first += p.first;
    all.second += p.second;
  }
  result.mean_m = origin + all.first / all.mass;
  result.std_dev_m = all.deviation();
  result.log_evidence = sampled.shift + std::log(all.mass);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    PosteriorRoot root;
    root.probability = parts[i].mass / all.mass;
    root.mean_m = origin + parts[i].first / parts[i].mass;
    root.std_dev_m = parts[i].deviation();
    root.from_m = i == 0 ? prior.low_m : turning_points[i - 1];
    root.to_m = i < turning_points.size() ? turning_points[i] : prior.high_m;
    result.roots.push_back(root);
  }
  result.low_m = distance_at_mass(density, sampled.shift, sampled.panels, 0.025 * all.mass);
  result.high_m = distance_at_mass(density, sampled.shift, sampled.panels, 0.975 * all.mass);
  result.mode_m = mode_between(
      density, sampled.best == 0 ? prior.low_m : sampled.node(sampled.best - 1),
      sampled.best + 1 == sampled.log_values.size() ? prior.high_m : sampled.node(sampled.best + 1));
  result.against_prior = density.is_surprise(result.mode_m);
  result.outcome = Outcome::converged;
  return result;
}

DistancePrior moved(const DistancePosterior& before, const DistancePrior& prior, double reach_m) {
  if (!(reach_m >= 0.0) || !std::isfinite(reach_m))
    throw InputError(fmt::format("moved: reach_m = {} is not a length", reach_m));
  DistancePrior next = prior;
  next.components.clear();
  double total = 0.0;
  for (const PosteriorRoot& root : before.roots) {
    if (!(root.probability > 1e-9) || !(root.std_dev_m > 0.0)) continue;
    next.components.push_back({root.probability, root.mean_m, root.std_dev_m, reach_m});
    total += root.probability;
  }
  for (DistancePrior::Component& c : next.components) c.weight /= total;
  return next;
}

}  // namespace rangecal
