// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/correction/posterior.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <array>
#include <boost/math/quadrature/gauss.hpp>
#include <cmath>
#include <limits>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

constexpr int nodes = 16;
/// Standard deviations from which on no distance explains a reading: noise does that twice in 10^9 readings.
constexpr double farthest_off = 4.0;

/// Nodes in [-1, 1] and weights of the rule, in the order of the nodes.
struct Rule {
  std::array<double, nodes> x, w;
  Rule() {
    const auto& abscissa = boost::math::quadrature::gauss<double, nodes>::abscissa();
    const auto& weights = boost::math::quadrature::gauss<double, nodes>::weights();
    for (std::size_t i = 0; i < nodes / 2; ++i) {
      x[nodes / 2 + i] = abscissa[i];
      x[nodes / 2 - 1 - i] = -abscissa[i];
      w[nodes / 2 + i] = w[nodes / 2 - 1 - i] = weights[i];
    }
  }
};
const Rule rule;

double cumulative_normal(double z) { return 0.5 * std::erfc(-z * std::numbers::sqrt2 / 2.0); }

/// Density of N(mean, sigma^2) + U(-half_width, half_width).
double density(const DistancePrior::Component& c, double d) {
  const double e = d - c.mean_m;
  if (!(c.half_width_m > 1e-9 * c.sigma_m) || c.half_width_m <= 0.0)
    return std::exp(-0.5 * e * e / (c.sigma_m * c.sigma_m) - half_log_two_pi) / c.sigma_m;
  if (!(c.sigma_m > 0.0)) return std::abs(e) <= c.half_width_m ? 0.5 / c.half_width_m : 0.0;
  const double a = (std::abs(e) - c.half_width_m) / c.sigma_m, b = (std::abs(e) + c.half_width_m) / c.sigma_m;
  return (cumulative_normal(-a) - cumulative_normal(-b)) / (2.0 * c.half_width_m);
}

struct Panel {
  double from, to, mass = 0.0;
};

/// Prior times likelihood of one reading.
class Density {
 public:
  Density(const EffectCorrector& corrector, double y, const ReadingSetting& setting,
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
  /// At d the prior's components give less than the share that is left for surprises.
  bool is_surprise(double d) const {
    return !prior_.components.empty() &&
           log_prior(d) < std::log(2.0 * prior_.surprise / (prior_.high_m - prior_.low_m));
  }
  double log_prior(double d) const {
    const double uniform = 1.0 / (prior_.high_m - prior_.low_m);
    if (prior_.components.empty()) return std::log(uniform);
    double sum = 0.0;
    for (const DistancePrior::Component& c : prior_.components) sum += c.weight * density(c, d);
    return std::log((1.0 - prior_.surprise) * sum + prior_.surprise * uniform);
  }
  double y() const { return y_; }

 private:
  const EffectCorrector& corrector_;
  double y_;
  const ReadingSetting& setting_;
  const DistancePrior& prior_;
};

/// A zero of mean(d) = y between a and b, where it changes sign.
double crossing(const Density& density, double a, double b, double at_a, double at_b) {
  for (int step = 0; step < 100 && b - a > 1e-12 * b; ++step) {  // Illinois' rule
    const double x = std::clamp((a * at_b - b * at_a) / (at_b - at_a), a, b);
    const double at = density.mean(x) - density.y();
    if (at == 0.0) return x;
    if ((at < 0.0) == (at_b < 0.0)) {
      b = x;
      at_b = at;
      at_a *= 0.5;
    } else {
      a = x;
      at_a = at;
      at_b *= 0.5;
    }
    if (std::abs(at) < 1e-13 * density.y()) return x;
  }
  return 0.5 * (a + b);
}

/// Ends of the panels, ascending: fine wherever the density may be narrow.
std::vector<double> breakpoints(const Density& density, const DistancePrior& prior,
                                const std::vector<double>& turning_points) {
  constexpr int coarse = 32;
  const double width = prior.high_m - prior.low_m;
  std::vector<double> ends;
  for (int i = 0; i <= coarse; ++i) ends.push_back(prior.low_m + width * i / coarse);
  ends.insert(ends.end(), turning_points.begin(), turning_points.end());
  std::sort(ends.begin(), ends.end());
  std::vector<double> extra;
  const auto around = [&](double at, double scale) {
    extra.push_back(at);
    for (const double k : {1.0, 2.0, 4.0, 7.0, 12.0, 25.0}) {
      extra.push_back(at - k * scale);
      extra.push_back(at + k * scale);
    }
  };
  const double step = 1e-6 * width;
  double before = density.mean(ends[0]) - density.y();
  for (std::size_t i = 1; i < ends.size(); ++i) {
    const double at = density.mean(ends[i]) - density.y();
    if ((before < 0.0) != (at < 0.0) && ends[i] > ends[i - 1]) {
      const double d = crossing(density, ends[i - 1], ends[i], before, at);
      const double slope = std::abs(density.mean(d + step) - density.mean(d - step)) / (2.0 * step);
      around(d, density.spread(d) / std::max(slope, 1e-3));
    }
    before = at;
  }
  for (const double d : turning_points) {  // |f''| / 2 delta^2 = s
    const double bend =
        std::abs(density.mean(d + 1e3 * step) - 2.0 * density.mean(d) + density.mean(d - 1e3 * step)) /
        (1e6 * step * step);
    around(d, std::sqrt(2.0 * density.spread(d) / std::max(bend, 1e-6)));
  }
  for (const DistancePrior::Component& c : prior.components) {
    const double scale = std::max(c.sigma_m, 1e-3 * c.half_width_m);
    around(c.mean_m - c.half_width_m, scale);
    around(c.mean_m + c.half_width_m, scale);
  }
  for (const double d : extra)
    if (d > prior.low_m && d < prior.high_m) ends.push_back(d);
  std::sort(ends.begin(), ends.end());
  ends.erase(std::unique(ends.begin(), ends.end(), [&](double a, double b) { return b - a < 1e-12 * width; }),
             ends.end());
  ends.back() = prior.high_m;
  return ends;
}

double integral(const Density& density, double shift, double from, double to) {
  const double centre = 0.5 * (from + to), half = 0.5 * (to - from);
  double sum = 0.0;
  for (int i = 0; i < nodes; ++i)
    sum += rule.w[i] * std::exp(density.log_at(centre + half * rule.x[i]) - shift);
  return sum * half;
}

/// Where `mass` is reached, panels of the given masses.
double quantile(const Density& density, double shift, const std::vector<Panel>& panels, double mass) {
  std::size_t i = 0;
  while (i + 1 < panels.size() && mass > panels[i].mass) mass -= panels[i++].mass;
  double a = panels[i].from, b = panels[i].to, x = a + (b - a) * std::clamp(mass / panels[i].mass, 0.0, 1.0);
  for (int step = 0; step < 60 && b - a > 1e-12 * b;
       ++step) {  // Newton's steps, bisection where they leave the bracket
    const double excess = integral(density, shift, panels[i].from, x) - mass;
    (excess < 0.0 ? a : b) = x;
    const double next = x - excess * std::exp(shift - density.log_at(x));
    const double old = x;
    x = next > a && next < b ? next : 0.5 * (a + b);
    if (std::abs(x - old) < 1e-11 * x) break;
  }
  return x;
}

double mode_near(const Density& density, double a, double b) {
  const double ratio = 0.5 * (std::sqrt(5.0) - 1.0);
  double x1 = b - ratio * (b - a), x2 = a + ratio * (b - a), f1 = density.log_at(x1), f2 = density.log_at(x2);
  while (b - a > 1e-9 * b) {
    if (f1 > f2) {
      b = x2;
      x2 = x1;
      f2 = f1;
      x1 = b - ratio * (b - a);
      f1 = density.log_at(x1);
    } else {
      a = x1;
      x1 = x2;
      f1 = f2;
      x2 = a + ratio * (b - a);
      f2 = density.log_at(x2);
    }
  }
  return 0.5 * (a + b);
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
  given.check();
  DistancePrior prior = given;
  if (prior.high_m == 0.0) {
    prior.low_m = corrector.calibration().range_min_m;
    prior.high_m = corrector.calibration().range_max_m;
  }
  if (!(prior.high_m > prior.low_m))
    throw InputError("distance_posterior: the calibration's range_m is empty and the prior gives none");
  const std::vector<double> turning_points =
      corrector.turning_points(prior.low_m, prior.high_m, reading_m, setting);
  const Density density(corrector, reading_m, setting, prior);
  const std::vector<double> ends = breakpoints(density, prior, turning_points);

  std::vector<Panel> panels;
  std::vector<double> log_values;
  double shift = -std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  for (std::size_t i = 1; i < ends.size(); ++i) {
    panels.push_back({ends[i - 1], ends[i]});
    const double centre = 0.5 * (ends[i - 1] + ends[i]), half = 0.5 * (ends[i] - ends[i - 1]);
    for (int k = 0; k < nodes; ++k) {
      log_values.push_back(density.log_at(centre + half * rule.x[k]));
      if (log_values.back() > shift) {
        shift = log_values.back();
        best = log_values.size() - 1;
      }
    }
  }
  DistancePosterior result;
  if (!std::isfinite(shift)) {
    result.reason = "the likelihood is 0 at every distance of the prior";
    return result;
  }
  double off = std::numeric_limits<double>::infinity();
  for (const double d : ends) off = std::min(off, density.off(d));
  if (off > farthest_off) {
    result.reason = fmt::format(
        "the reading is {:.0f} standard deviations off at every distance of the prior, {} to {} m", off,
        prior.low_m, prior.high_m);
    return result;
  }
  struct Sums {
    double mass = 0.0, first = 0.0, second = 0.0;
    void add(double w, double d) {
      mass += w;
      first += w * d;
      second += w * d * d;
    }
  };
  const auto node_at = [&](std::size_t k) {
    const Panel& p = panels[k / nodes];
    return 0.5 * (p.from + p.to) + 0.5 * (p.to - p.from) * rule.x[k % nodes];
  };
  const double origin = node_at(best);  // moments about it: nothing cancels
  std::vector<Sums> parts(turning_points.size() + 1);
  std::size_t part = 0;
  for (std::size_t i = 0; i < panels.size(); ++i) {
    while (part < turning_points.size() && panels[i].from >= turning_points[part] - 1e-12 * prior.high_m)
      ++part;
    for (int k = 0; k < nodes; ++k) {
      const double w =
          rule.w[k] * 0.5 * (panels[i].to - panels[i].from) * std::exp(log_values[i * nodes + k] - shift);
      panels[i].mass += w;
      parts[part].add(w, node_at(i * nodes + k) - origin);
    }
  }
  Sums all;
  for (const Sums& p : parts) {
    all.mass += p.mass;
    all.first += p.first;
    all.second += p.second;
  }
  const auto deviation = [](const Sums& s) {
    return std::sqrt(std::max(0.0, s.second / s.mass - std::pow(s.first / s.mass, 2)));
  };
  result.mean_m = origin + all.first / all.mass;
  result.std_dev_m = deviation(all);
  result.log_evidence = shift + std::log(all.mass);
  for (std::size_t i = 0; i < parts.size(); ++i) {
    PosteriorRoot root;
    root.probability = parts[i].mass / all.mass;
    root.mean_m = origin + parts[i].first / parts[i].mass;
    root.std_dev_m = deviation(parts[i]);
    root.from_m = i == 0 ? prior.low_m : turning_points[i - 1];
    root.to_m = i < turning_points.size() ? turning_points[i] : prior.high_m;
    result.roots.push_back(root);
  }
  result.low_m = quantile(density, shift, panels, 0.025 * all.mass);
  result.high_m = quantile(density, shift, panels, 0.975 * all.mass);
  result.mode_m = mode_near(density, best == 0 ? prior.low_m : node_at(best - 1),
                            best + 1 == log_values.size() ? prior.high_m : node_at(best + 1));
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
