// SPDX-License-Identifier: BSD-3-Clause
#include "correction/reading_density.hpp"

#include <algorithm>
#include <boost/math/quadrature/gauss.hpp>

#include "rangecal/core/distributions.hpp"

namespace rangecal {
namespace {

/// Density of N(mean, sigma^2) + U(-half_width, half_width).
double component_density(const DistancePrior::Component& c, double d) {
  const double e = d - c.mean_m;
  if (!(c.half_width_m > 1e-9 * c.sigma_m) || c.half_width_m <= 0.0)
    return std::exp(-0.5 * e * e / (c.sigma_m * c.sigma_m) - half_log_two_pi) / c.sigma_m;
  if (!(c.sigma_m > 0.0)) return std::abs(e) <= c.half_width_m ? 0.5 / c.half_width_m : 0.0;
  const double a = (std::abs(e) - c.half_width_m) / c.sigma_m, b = (std::abs(e) + c.half_width_m) / c.sigma_m;
  return (normal_below(-a) - normal_below(-b)) / (2.0 * c.half_width_m);
}

/// What lies between low and high of a component: all of a narrow one, whose mean is within.
double mass_within(const DistancePrior::Component& c, double low, double high) {
  constexpr int pieces = 200;
  if (std::max(c.sigma_m, c.half_width_m) < 0.25 * (high - low)) return 1.0;
  double sum = 0.0;
  for (int i = 0; i < pieces; ++i) sum += component_density(c, low + (high - low) * (i + 0.5) / pieces);
  return std::min(1.0, sum * (high - low) / pieces);
}

/// A zero of mean(d) = y between a and b, where it changes sign.
double crossing(const ReadingDensity& density, double a, double b, double at_a, double at_b) {
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

double panel_integral(const ReadingDensity& density, double shift, double from, double to) {
  const double centre = 0.5 * (from + to), half = 0.5 * (to - from);
  double sum = 0.0;
  for (int i = 0; i < gauss_nodes; ++i)
    sum += gauss_rule.w[i] * std::exp(density.log_at(centre + half * gauss_rule.x[i]) - shift);
  return sum * half;
}

}  // namespace

GaussRule::GaussRule() {
  const auto& abscissa = boost::math::quadrature::gauss<double, gauss_nodes>::abscissa();
  const auto& weights = boost::math::quadrature::gauss<double, gauss_nodes>::weights();
  for (std::size_t i = 0; i < gauss_nodes / 2; ++i) {
    x[gauss_nodes / 2 + i] = abscissa[i];
    x[gauss_nodes / 2 - 1 - i] = -abscissa[i];
    w[gauss_nodes / 2 + i] = w[gauss_nodes / 2 - 1 - i] = weights[i];
  }
}

double ReadingDensity::log_prior(double d) const {
  const double uniform = 1.0 / (prior_.high_m - prior_.low_m);
  if (prior_.components.empty()) return std::log(uniform);
  double sum = 0.0;
  for (const DistancePrior::Component& c : prior_.components) sum += c.weight * component_density(c, d);
  return std::log((1.0 - prior_.surprise) * sum + prior_.surprise * uniform);
}

bool ReadingDensity::is_surprise(double d) const {
  const double uniform = prior_.surprise / (prior_.high_m - prior_.low_m);
  if (prior_.components.empty() || !(log_prior(d) < std::log(2.0 * uniform))) return false;
  double sum = 0.0, mass = 0.0;
  for (const DistancePrior::Component& c : prior_.components) {
    sum += c.weight * component_density(c, d);
    mass += c.weight * mass_within(c, prior_.low_m, prior_.high_m);
  }
  return (1.0 - prior_.surprise) * sum < uniform * mass;
}

std::vector<double> panel_ends(const ReadingDensity& density, const DistancePrior& prior,
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
  const auto slope_at = [&](double d) {
    const double a = std::max(prior.low_m, d - step), b = std::min(prior.high_m, d + step);
    return std::max(std::abs(density.mean(b) - density.mean(a)) / (b - a), 1e-3);
  };
  double before = density.mean(ends[0]) - density.y();
  for (std::size_t i = 1; i < ends.size(); ++i) {
    const double at = density.mean(ends[i]) - density.y();
    if ((before < 0.0) != (at < 0.0) && ends[i] > ends[i - 1]) {
      const double d = crossing(density, ends[i - 1], ends[i], before, at);
      around(d, density.spread(d) / slope_at(d));
    }
    before = at;
  }
  for (const double d :
       {prior.low_m, prior.high_m})  // where the reading lies beyond the curve, the density falls off by z'
    around(d, density.spread(d) / (slope_at(d) * std::max(1.0, density.off(d))));
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

double distance_at_mass(const ReadingDensity& density, double shift, const std::vector<Panel>& panels,
                        double mass) {
  std::size_t i = 0;
  while (i + 1 < panels.size() && mass > panels[i].mass) mass -= panels[i++].mass;
  double a = panels[i].from, b = panels[i].to, x = a + (b - a) * std::clamp(mass / panels[i].mass, 0.0, 1.0);
  for (int step = 0; step < 60 && b - a > 1e-12 * b;
       ++step) {  // Newton's steps, bisection where they leave the bracket
    const double excess = panel_integral(density, shift, panels[i].from, x) - mass;
    (excess < 0.0 ? a : b) = x;
    const double next = x - excess * std::exp(shift - density.log_at(x));
    const double old = x;
    x = next > a && next < b ? next : 0.5 * (a + b);
    if (std::abs(x - old) < 1e-11 * x) break;
  }
  return x;
}

double mode_between(const ReadingDensity& density, double a, double b) {
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

}  // namespace rangecal
