// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/tail_law.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

bool one_sided(const Contamination& law) { return law.mean_m != 0.0; }

double sign_of(const Contamination& law) { return law.mean_m < 0.0 ? -1.0 : 1.0; }

constexpr double largest_share = 0.999;

/// Ratio of an even share's standard deviation to the spread.
double wide(const Contamination& law, double s) { return std::hypot(1.0, law.extra_sigma_m / s); }

/// Slope of the log density of one share's readings in its size. `excess`: what their extra error is expected to be, given z, in
/// units of s; that of an exponential one is all that its mean knows (Fisher's identity).
double in_size(const Contamination& law, double z, double s, double excess) {
  if (!one_sided(law)) {
    const double ratio = wide(law, s);
    return (z * z / (ratio * ratio) - 1.0) * law.extra_sigma_m / (s * s * ratio * ratio);
  }
  const double lambda = std::abs(law.mean_m) / s, end = law.end_m / s;
  const double cut = std::isfinite(end) ? end / std::expm1(end / lambda) : 0.0;
  return sign_of(law) * (std::abs(excess) - lambda + cut) / (lambda * lambda * s);
}

/// Probabilities below and above z of one share.
struct Tails {
  double below = 0.0, above = 0.0;
};

Tails tails_of(const Contamination& law, double z, double s) {
  if (!one_sided(law)) return {normal_below(z / wide(law, s)), normal_below(-z / wide(law, s))};
  const double sign = sign_of(law);
  const double below = one_sided_cumulative(std::abs(law.mean_m) / s, sign * z, law.end_m / s);
  return sign > 0.0 ? Tails{below, 1.0 - below} : Tails{1.0 - below, below};
}

/// z at which the normal's upper tail is `upper`, in [0, 1/2]; 37 is where it leaves double precision.
double quantile_above(double upper) {
  if (!(upper > 1e-299)) return 37.0;
  if (upper >= 0.5) return 0.0;
  return normal_upper_quantile(upper);
}

}  // namespace

bool TailLaw::add(const Contamination& part) {
  if (!(part.share > 0.0) || count_ == most) return false;
  const double odds = part.share / (1.0 - std::min(part.share, largest_share));
  parts_[count_++] = {part, odds, std::log(odds)};
  odds_ += odds;
  log_body_ = -std::log1p(odds_);
  return true;
}

LogDensity TailLaw::density(double e, double s, Slopes* slopes) const {
  const double z = e / s;
  struct Term {
    double log = 0.0, weight = 1.0, mean = 0.0, variance = 0.0;
  };
  std::array<Term, most + 1> terms;
  terms[0].log = log_body_ - half_log_two_pi - 0.5 * z * z;
  double high = terms[0].log;
  for (std::size_t k = 0; k < count_; ++k) {
    const Contamination& law = parts_[k].law;
    const double log_share = log_body_ + parts_[k].log_odds;
    if (one_sided(law)) {
      const double sign = sign_of(law);
      const OneSidedDensity at = one_sided_density(std::abs(law.mean_m) / s, sign * z, law.end_m / s);
      terms[k + 1] = {log_share + at.log_density, 1.0, sign * at.mean, at.variance};
    } else {
      const double ratio = wide(law, s);
      terms[k + 1] = {log_share - std::log(ratio) - half_log_two_pi - 0.5 * z * z / (ratio * ratio),
                      1.0 / (ratio * ratio), 0.0, 0.0};
    }
    high = std::max(high, terms[k + 1].log);
  }
  double total = 0.0;
  for (std::size_t k = 0; k <= count_; ++k) total += std::exp(terms[k].log - high);
  LogDensity out;
  out.value = high + std::log(total);
  double weight = 0.0, first = 0.0, second = 0.0;
  for (std::size_t k = 0; k <= count_; ++k) {
    const Term& term = terms[k];
    const double r = std::exp(term.log - out.value);
    if (k > 0) out.outlier += r;
    if (k > 0 && slopes) {
      const Part& part = parts_[k - 1];
      const double body_share =
          1.0 - std::min(part.law.share, largest_share);  // d odds / d p = 1 / body_share^2
      slopes->in_share[k - 1] = (r / part.odds - body()) / (body_share * body_share);
      slopes->in_size[k - 1] = r * in_size(part.law, z, s, term.mean);
    }
    weight += r * term.weight;
    first += r * term.weight * term.mean;
    second += r * term.weight * (term.mean * term.mean + term.variance);
  }
  out.weight = weight;
  out.shift = first / weight;
  out.extra_square = std::max(0.0, second - first * out.shift);
  out.derivative = first - weight * z;
  return out;
}

double TailLaw::normal_score(double e, double s) const {
  const double z = e / s;
  Tails all{body() * normal_below(z), body() * normal_below(-z)};
  for (std::size_t k = 0; k < count_; ++k) {
    const Tails own = tails_of(parts_[k].law, z, s);
    all.below += body() * parts_[k].odds * own.below;
    all.above += body() * parts_[k].odds * own.above;
  }
  return all.below < all.above ? -quantile_above(all.below) : quantile_above(all.above);
}

double TailLaw::negentropy(double s) const {
  double low = 10.0, high = 10.0;  // reaches of the law on either side [standard deviations]
  for (std::size_t k = 0; k < count_; ++k) {
    const Contamination& law = parts_[k].law;
    if (!one_sided(law)) {
      low = std::max(low, 10.0 * wide(law, s)), high = std::max(high, 10.0 * wide(law, s));
      continue;
    }
    const double reach = 10.0 + std::min(law.end_m, 40.0 * std::abs(law.mean_m)) / s;
    (law.mean_m < 0.0 ? low : high) = std::max(law.mean_m < 0.0 ? low : high, reach);
  }
  // by the trapezoidal rule in arsinh z
  constexpr double step = 0.05;
  double total = 0.0, first = 0.0, second = 0.0, entropy = 0.0;
  for (double u = -std::asinh(low); u <= std::asinh(high); u += step) {
    const double z = std::sinh(u), value = density(z * s, s).value;
    const double mass = step * std::cosh(u) * std::exp(value);
    total += mass, first += mass * z, second += mass * z * z, entropy -= mass * value;
  }
  const double mean = first / total, variance = second / total - mean * mean;
  return 2.0 * (0.5 * std::log(2.0 * std::numbers::pi * std::numbers::e * variance) - entropy);
}

double TailLaw::mean() const {
  double sum = 0.0;
  for (std::size_t k = 0; k < count_; ++k) {
    const Contamination& law = parts_[k].law;
    if (!one_sided(law)) continue;
    const double tau = std::abs(law.mean_m);
    const double cut = std::isfinite(law.end_m) ? law.end_m / std::expm1(law.end_m / tau) : 0.0;
    sum += body() * parts_[k].odds * sign_of(law) * (tau - cut);
  }
  return sum;
}

double TailLaw::draw(Random& random) const {
  if (empty()) return 0.0;
  double left = random.uniform();
  for (std::size_t k = 0; k < count_; ++k) {
    const Contamination& law = parts_[k].law;
    const double share = body() * parts_[k].odds;
    if (left < share) {
      if (!one_sided(law)) return random.normal(0.0, law.extra_sigma_m);
      const double tau = std::abs(law.mean_m);
      return -sign_of(law) * tau * std::log1p(random.uniform() * std::expm1(-law.end_m / tau));
    }
    left -= share;
  }
  return 0.0;
}

}  // namespace rangecal
