// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/problems/tail_law.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include "rangecal/core/distributions.hpp"
#include "rangecal/core/quantiles.hpp"

namespace rangecal {
namespace {

bool one_sided(const Contamination& law) { return law.mean_m != 0.0; }

double sign_of(const Contamination& law) { return law.mean_m < 0.0 ? -1.0 : 1.0; }

constexpr double largest_share = 0.999;

/// Ratio of an even share's standard deviation to the spread.
double wide(const Contamination& law, double s) { return std::hypot(1.0, law.extra_sigma_m / s); }

/// Logarithms of odds beyond which their numbers are left.
constexpr double largest_log_odds = 300.0;

/// Of a one-sided error whose end, if it has one, is out of reach, of mean lambda in units of s, to the positive side: with x = z -
/// 1 / lambda,
///   odds = sqrt(2 pi) / lambda Phi(x) exp(x^2 / 2);   given z it is N(x, 1) above 0, of mean x + phi(x) / Phi(x).
/// An end at L divides the odds by 1 - exp(-L / lambda).
ExtraError one_sided_with_end_out_of_reach(double lambda, double z, double end) {
  const double x = z - 1.0 / lambda;
  const double mills_inverse = std::sqrt(2.0 * std::numbers::pi) * normal_below(x) * std::exp(0.5 * x * x);
  ExtraError extra;
  extra.odds = mills_inverse / lambda / share_before_end(lambda, end);
  extra.mean = std::max(0.0, x + 1.0 / mills_inverse);
  extra.variance = std::max(0.0, 1.0 - extra.mean / mills_inverse);
  return extra;
}

/// None where the odds may leave the numbers.
std::optional<ExtraError> extra_given(const Contamination& law, double z, double s) {
  if (!one_sided(law)) {
    const double ratio = wide(law, s), precision = 1.0 / (ratio * ratio);
    const double exponent = 0.5 * z * z * (1.0 - precision);
    if (!(exponent < largest_log_odds)) return std::nullopt;
    return ExtraError{std::exp(exponent) / ratio, precision, 0.0, 0.0};
  }
  const double sign = sign_of(law), lambda = std::abs(law.mean_m) / s, x = sign * z - 1.0 / lambda;
  if (!(0.5 * x * x < largest_log_odds)) return std::nullopt;
  ExtraError extra;
  const double end = law.end_m / s;
  if (ends_out_of_reach(x, end)) {
    extra = one_sided_with_end_out_of_reach(lambda, sign * z, end);
  } else {
    const OneSidedDensity at = one_sided_density(lambda, sign * z, end);
    const double log_odds = at.log_density + half_log_two_pi + 0.5 * z * z;
    if (!(log_odds < largest_log_odds)) return std::nullopt;
    extra = {std::exp(log_odds), 1.0, at.mean, at.variance};
  }
  extra.mean *= sign;
  return extra;
}

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
  const double z = e / s, log_normal = log_body_ - half_log_two_pi - 0.5 * z * z;
  std::array<ExtraError, most> extras;
  std::array<double, most> share{};  // of each, given z
  double odds = 0.0;
  for (std::size_t k = 0; k < count_; ++k) {
    const std::optional<ExtraError> extra = extra_given(parts_[k].law, z, s);
    if (!extra) return density_far_out(z, s, slopes);
    extras[k] = *extra;
    share[k] = parts_[k].odds * extra->odds;
    odds += share[k];
  }
  for (std::size_t k = 0; k < count_; ++k) share[k] /= 1.0 + odds;
  return mixed(z, s, log_normal + std::log1p(odds), 1.0 / (1.0 + odds), extras, share, slopes);
}

LogDensity TailLaw::density_far_out(double z, double s, Slopes* slopes) const {
  const double log_normal = log_body_ - half_log_two_pi - 0.5 * z * z;
  std::array<ExtraError, most> extras;
  std::array<double, most> logs{}, share{};
  double high = log_normal;
  for (std::size_t k = 0; k < count_; ++k) {
    const Contamination& law = parts_[k].law;
    const double log_share = log_body_ + parts_[k].log_odds;
    if (one_sided(law)) {
      const double sign = sign_of(law);
      const OneSidedDensity at = one_sided_density(std::abs(law.mean_m) / s, sign * z, law.end_m / s);
      extras[k] = {1.0, 1.0, sign * at.mean, at.variance};
      logs[k] = log_share + at.log_density;
    } else {
      const double ratio = wide(law, s), precision = 1.0 / (ratio * ratio);
      extras[k] = {1.0, precision, 0.0, 0.0};
      logs[k] = log_share - std::log(ratio) - half_log_two_pi - 0.5 * z * z * precision;
    }
    high = std::max(high, logs[k]);
  }
  double total = std::exp(log_normal - high);
  for (std::size_t k = 0; k < count_; ++k) total += std::exp(logs[k] - high);
  const double value = high + std::log(total);
  for (std::size_t k = 0; k < count_; ++k) share[k] = std::exp(logs[k] - value);
  return mixed(z, s, value, std::exp(log_normal - value), extras, share, slopes);
}

LogDensity TailLaw::mixed(double z, double s, double value, double body_given_z,
                          const std::array<ExtraError, most>& extras, const std::array<double, most>& share,
                          Slopes* slopes) const {
  LogDensity out;
  out.value = value;
  double weight = body_given_z, first = 0.0, second = 0.0, square = body_given_z * z * z;
  for (std::size_t k = 0; k < count_; ++k) {
    const ExtraError& extra = extras[k];
    const double r = share[k];
    out.outlier += r;
    if (slopes) {
      const Part& part = parts_[k];
      const double body_share =
          1.0 - std::min(part.law.share, largest_share);  // d odds / d p = 1 / body_share^2
      slopes->in_share[k] = (r / part.odds - body()) / (body_share * body_share);
      slopes->in_size[k] = r * in_size(part.law, z, s, extra.mean);
    }
    weight += r * extra.weight;
    first += r * extra.weight * extra.mean;
    second += r * extra.weight * (extra.mean * extra.mean + extra.variance);
    square += r * extra.weight * extra.weight * (std::pow(z - extra.mean, 2) + extra.variance);
  }
  out.weight = weight;
  out.shift = first / weight;
  out.extra_square = std::max(0.0, second - first * out.shift);
  out.derivative = first - weight * z;
  // What is expected of the slope's square, were the extra error known, is what not knowing it costs (Louis 1982).
  if (slopes) slopes->curvature = weight - square + out.derivative * out.derivative;
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
