// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/change_detector.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <Eigen/LU>
#include <algorithm>
#include <boost/math/tools/minima.hpp>
#include <cmath>
#include <numbers>
#include <utility>

#include "change/over_range.hpp"
#include "change/wave.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/sum_of_logs.hpp"
#include "rangecal/solvers/statistics/median.hpp"

namespace rangecal {
namespace {

using Eigen::Index;
using Eigen::MatrixXd;
using Eigen::VectorXd;

/// dz / db at a reading.
double direction(ChangeKind kind, int wave, double f, double s, double bearing) {
  switch (kind) {
    case ChangeKind::window:
      return 1.0 / s;
    case ChangeKind::baseline:
      return f / s;
    case ChangeKind::pointing:
      return f * f / s;
    case ChangeKind::encoder:
      return (wave == 0 ? std::cos(bearing) : std::sin(bearing)) / s;
    case ChangeKind::noise:
    case ChangeKind::outliers:
      break;
  }
  return 0.0;
}

constexpr double farthest_summed = 1e100;  // standard deviations: the squares of what is beyond have no sum
constexpr double outlier_scale = 20.0;     // of outliers that the reference's shape does not have

bool is_mixture(const NoiseShapeParameters& shape) {
  return shape.shape == NoiseShape::contaminated || shape.shape == NoiseShape::one_sided;
}

/// log density of z where the share of outliers is `share`.
double log_with_share(const NoiseShapeParameters& shape, double share, double z, double s) {
  if (is_mixture(shape)) {
    NoiseShapeParameters other = shape;
    other.outlier_share = share;
    return log_density(other, z, s).value;
  }
  const double body = std::log1p(-share) + log_density(shape, z, s).value,
               wide = std::log(share / outlier_scale) - half_log_two_pi -
                      0.5 * z * z / (outlier_scale * outlier_scale);
  return sum_of_logs(body, wide).log_sum;
}

/// log density of z where the spread is e^log_rho times what it was.
double log_with_spread(const ShapeDensity& density_at, double log_rho, double z, double s) {
  const double rho = std::exp(log_rho);
  return density_at(z / rho, s * rho).value - log_rho;
}

/// Of a power law; a polynomial's is taken as exact.
double variance_of_log_sigma(const Calibration& c) {
  if (!has_sigma(c.noise.law) || c.noise_estimates.empty()) return 0.0;
  return std::pow(c.noise_estimates[0].std_dev.value_or(0.0) / c.noise.parameters[0], 2);
}

std::int64_t whole_count(double value) {
  if (!(value >= 0.0 && value < 0x1p53))
    throw InputError("ChangeDetector: the state counts what cannot be counted");
  return static_cast<std::int64_t>(value);
}

/// Of R, S and sum z^2.
double sum_in(double value) {
  if (!(value >= 0.0)) throw InputError("ChangeDetector: the state has a sum below 0 that cannot be");
  return value;
}

constexpr double this_version = -3.0;  // begins a state; those before begin with a count
constexpr double log_farthest = 8.0;   // of a factor on the spread

/// The readings since an alarm, and the likeliest size of a change of each kind.
class ReadingsSince {
 public:
  ReadingsSince(const Calibration& reference, const ShapeDensity& density,
                const std::vector<ChangeDetector::Reading>& readings)
      : reference_(reference), density_(density), readings_(readings) {
    for (const ChangeDetector::Reading& one : readings) {
      f_.push_back(evaluate_polynomial(reference.alpha, one.true_m));
      s_.push_back(reference.noise.spread(one.true_m, f_.back()));
      z_.push_back((one.reading_m - f_.back()) / s_.back());
    }
  }

  bool finite() const {
    for (std::size_t i = 0; i < z_.size(); ++i)
      if (!(s_[i] > 0.0 && std::abs(z_[i]) < farthest_summed)) return false;
    return true;
  }
  double typical_spread() const { return upper_median(s_); }

  /// Size b of sum_j b_j g_j with its covariance, and the gain of likelihood.
  struct Along {
    VectorXd size;
    MatrixXd covariance;
    double gain = 0.0;
  };
  /// By Newton's steps with the robust weights, from b = 0 and from b of least squares. None where the directions are alike.
  std::optional<Along> along(const std::vector<std::pair<ChangeKind, int>>& directions,
                             double location) const {
    const Index size = static_cast<Index>(directions.size()), curve = reference_.alpha.size();
    const auto count = static_cast<Index>(z_.size());
    MatrixXd g(count, size), x(count, curve);
    for (Index i = 0; i < count; ++i) {
      const auto at = static_cast<std::size_t>(i);
      for (Index j = 0; j < size; ++j) {
        const auto& [kind, wave] = directions[static_cast<std::size_t>(j)];
        g(i, j) = direction(kind, wave, f_[at], s_[at], readings_[at].bearing_rad);
      }
      x.row(i) = powers_of(readings_[at].true_m, curve).transpose() / s_[at];
    }
    const MatrixXd squares = g.transpose() * g;
    if (!(squares.determinant() > 1e-9 * squares.diagonal().prod())) return std::nullopt;
    const VectorXd z = VectorXd::Map(z_.data(), count), least = squares.ldlt().solve(g.transpose() * z);
    Along best;
    best.gain = -1.0;
    for (const VectorXd& start : {VectorXd(VectorXd::Zero(size)), least}) {
      VectorXd b = start;
      constexpr int iterations = 50;
      for (int iteration = 0; iteration < iterations; ++iteration) {
        VectorXd U = VectorXd::Zero(size);
        MatrixXd W = MatrixXd::Zero(size, size);
        for (Index i = 0; i < count; ++i) {
          const LogDensity at = density_(z[i] - g.row(i).dot(b), s_[static_cast<std::size_t>(i)]);
          U -= at.derivative * g.row(i).transpose();
          W += at.weight * g.row(i).transpose() * g.row(i);
        }
        const VectorXd step = W.ldlt().solve(U);
        if (!step.allFinite()) break;
        b += step;
        constexpr double still = 1e-6;  // standard deviations
        if (step.dot(squares * step) < still * still) break;
      }
      double gain = 0.0;
      for (Index i = 0; i < count; ++i) {
        const double s = s_[static_cast<std::size_t>(i)];
        gain += density_(z[i] - g.row(i).dot(b), s).value - density_(z[i], s).value;
      }
      if (gain > best.gain) {
        best.gain = gain;
        best.size = b;
      }
    }
    if (best.size.size() == 0) return std::nullopt;
    const MatrixXd C = reference_.alpha_covariance.value_or(MatrixXd::Zero(curve, curve)),
                   A = squares.inverse() * (g.transpose() * x);
    best.covariance = squares.inverse() / location + A * C * A.transpose();
    return best;
  }

  /// Argument of the largest sum of log_density(argument, z, s), and its gain over the reference's density.
  template <typename LogDensityOf>
  std::pair<double, double> likeliest(double low, double high, const LogDensityOf& log_density_of) const {
    const auto negative = [&](double at) {
      double sum = 0.0;
      for (std::size_t i = 0; i < z_.size(); ++i)
        sum -= log_density_of(at, z_[i], s_[i]) - density_(z_[i], s_[i]).value;
      return sum;
    };
    constexpr int pieces = 16, bits = 26;
    int lowest = 0;
    std::vector<double> at(pieces + 1);
    for (int k = 0; k <= pieces; ++k) {
      at[static_cast<std::size_t>(k)] = negative(low + (high - low) * k / pieces);
      if (at[static_cast<std::size_t>(k)] < at[static_cast<std::size_t>(lowest)]) lowest = k;
    }
    const double piece = (high - low) / pieces, about = low + piece * lowest;
    const auto [argument, value] = boost::math::tools::brent_find_minima(
        negative, std::max(low, about - piece), std::min(high, about + piece), bits);
    return {argument, -value};
  }

 private:
  const Calibration& reference_;
  const ShapeDensity& density_;
  const std::vector<ChangeDetector::Reading>& readings_;
  std::vector<double> f_, s_, z_;
};

}  // namespace

const char* to_string(ChangeKind kind) {
  switch (kind) {
    case ChangeKind::window:
      return "window";
    case ChangeKind::baseline:
      return "baseline";
    case ChangeKind::pointing:
      return "pointing";
    case ChangeKind::encoder:
      return "encoder";
    case ChangeKind::noise:
      return "noise";
    case ChangeKind::outliers:
      return "outliers";
  }
  return "window";
}

void ChangeOptions::check() const {
  const auto refuse = [](const std::string& what) { throw InputError("ChangeOptions: " + what); };
  if (!(run_length >= 100.0 && run_length <= 1e12))
    refuse(fmt::format("run_length = {} is outside of 100 .. 1e12", run_length));
  if (!(shift >= 0.01 && shift <= 5.0)) refuse(fmt::format("shift = {} is outside of 0.01 .. 5", shift));
  if (!(noise_factor > 1.01 && noise_factor <= 10.0))
    refuse(fmt::format("noise_factor = {} is outside of 1.01 .. 10", noise_factor));
  if (!(outlier_share >= 1e-4 && outlier_share <= 0.2))
    refuse(fmt::format("outlier_share = {} is outside of 1e-4 .. 0.2", outlier_share));
  if (naming < 10 || naming > 1000000) refuse(fmt::format("naming = {} is outside of 10 .. 1000000", naming));
}

ChangeDetector::ChangeDetector(const Calibration& reference, const ChangeOptions& options)
    : reference_(reference), options_(options), shape_(noise_shape_of(reference, "range")), density_(shape_) {
  options.check();
  if (!is_usable(reference.outcome) || reference.alpha.size() == 0 ||
      !(reference.range_max_m > reference.range_min_m))
    throw InputError("ChangeDetector: the calibration has no curve");
  require_polynomial(reference, "ChangeDetector");
  if (!reference.effects.empty()) throw InputError("ChangeDetector: the calibration holds effects");
  for (const ChangeKind kind : {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing})
    add_charts(kind, 0);
  if (options_.bearings)
    for (const int wave : {0, 1}) add_charts(ChangeKind::encoder, wave);
  const double log_rho = std::log(options_.noise_factor);
  for (const double sign : {1.0, -1.0}) charts_.push_back({ChangeKind::noise, 0, sign * log_rho});
  constexpr double times = 4.0, highest = 0.25;
  const double share = is_mixture(shape_) ? shape_.outlier_share : 0.0;
  charts_.push_back(
      {ChangeKind::outliers, 0, std::min(highest, std::max(options_.outlier_share, times * share))});
  if (share > options_.outlier_share) charts_.push_back({ChangeKind::outliers, 0, share / times});
  start_again();
}

double ChangeDetector::step_of(const Chart& chart, double f, double s, double z, double bearing,
                               double log_before) const {
  if (chart.kind == ChangeKind::noise) return log_with_spread(density_, chart.size, z, s) - log_before;
  if (chart.kind == ChangeKind::outliers) return log_with_share(shape_, chart.size, z, s) - log_before;
  const double bg = chart.size * direction(chart.kind, chart.wave, f, s, bearing);
  if (shape_.shape == NoiseShape::gaussian) return bg * (z - 0.5 * bg);  // exact where z is large
  return density_(z - bg, s).value - log_before;
}

void ChangeDetector::add_charts(ChangeKind kind, int wave) {
  double sum = 0.0;
  over_range(reference_, "ChangeDetector", [&](double f, double s) {
    // a wave is as large in the mean over a turn as over bearings of 45 degrees
    sum += std::pow(direction(kind, wave, f, s, 0.25 * std::numbers::pi), 2) / distances_of_range;
  });
  const double size = options_.shift / std::sqrt(sum);
  for (const double sign : {1.0, -1.0}) charts_.push_back({kind, wave, sign * size});
}

std::optional<ChangeAlarm> ChangeDetector::add(double true_m, double reading_m, double bearing_rad) {
  if (!(reading_m > 0.0) || !std::isfinite(reading_m) || !std::isfinite(true_m) ||
      !std::isfinite(bearing_rad))
    return std::nullopt;
  const double f = evaluate_polynomial(reference_.alpha, true_m), s = reference_.noise.spread(true_m, f);
  const double z = (reading_m - f) / s;
  if (!(s > 0.0 && std::isfinite(s) && std::abs(z) < farthest_summed && f * f / s < farthest_summed))
    return std::nullopt;
  ++readings_;
  if (naming_left_ > 0) {
    since_.push_back({true_m, reading_m, bearing_rad});
    if (--naming_left_ > 0) return std::nullopt;
    name(open_);
    start_again();
    return open_;
  }
  const double log_before = density_(z, s).value;
  for (Chart& chart : charts_) {
    chart.step = step_of(chart, f, s, z, bearing_rad, log_before);
    chart.before = chart.ratio;
    chart.ratio = (1.0 + chart.before) * std::exp(chart.step);
    chart.value = std::max(0.0, chart.value + chart.step);
    if (chart.value == 0.0) chart.since = readings_;
  }
  const Chart* loudest_chart = loudest();
  if (!loudest_chart) return std::nullopt;
  open_ = {};
  open_.reading = readings_;
  open_.since = loudest_chart->since;
  start_again();
  naming_left_ = options_.naming;
  return open_;
}

const ChangeDetector::Chart* ChangeDetector::loudest() const {
  double sum = 0.0;
  for (const Chart& chart : charts_) sum += chart.ratio;
  if (!(sum > options_.run_length * static_cast<double>(charts_.size()))) return nullptr;
  const auto log_ratio = [](const Chart& chart) { return std::log1p(chart.before) + chart.step; };
  return &*std::max_element(charts_.begin(), charts_.end(),
                            [&](const Chart& a, const Chart& b) { return log_ratio(a) < log_ratio(b); });
}

void ChangeDetector::start_again() {
  for (Chart& chart : charts_) {
    chart.ratio = chart.before = chart.step = chart.value = 0.0;
    chart.since = readings_;
  }
  since_.clear();
}

void ChangeDetector::name(ChangeAlarm& alarm) const {
  const ReadingsSince readings(reference_, density_, since_);
  const double N = static_cast<double>(since_.size());
  ChangeAlarm best = alarm;
  double most = -1.0, all = 0.0;  // gain of the best, sum of e^(gain - most)
  const auto offer = [&](const ChangeAlarm& kind, double gain) {
    if (gain > most) best = kind;
    const double higher = std::max(most, gain);
    all = all * std::exp(most - higher) + std::exp(gain - higher);
    most = higher;
  };
  ChangeAlarm one = alarm;
  one.named = true;
  const ShapeInformation information = shape_information(shape_, readings.typical_spread());
  for (const ChangeKind kind : {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing}) {
    const auto change = readings.along({{kind, 0}}, information.location);
    if (!change) continue;
    one.kind = kind;
    one.size = change->size[0];
    one.std_dev = std::sqrt(change->covariance(0, 0));
    offer(one, change->gain);
  }
  const auto [log_rho, of_spread] =
      readings.likeliest(-log_farthest, log_farthest,
                         [&](double at, double z, double s) { return log_with_spread(density_, at, z, s); });
  one.kind = ChangeKind::noise;
  one.size = log_rho;
  one.std_dev = std::sqrt(1.0 / (N * information.spread(0, 0)) + variance_of_log_sigma(reference_));
  offer(one, of_spread);
  if (options_.bearings) {
    // Bearings that are all alike tell an offset, too.
    if (const auto waves =
            readings.along({{ChangeKind::encoder, 0}, {ChangeKind::encoder, 1}}, information.location)) {
      tell_wave(waves->size, waves->covariance, one);
      offer(one, waves->gain - 0.5 * std::log(N));
      one.phase_rad.reset();
    }
  }
  constexpr double least_logit = -12.0, most_logit = 0.0;  // shares of 6e-6 to 1 / 2
  const auto share_at = [](double logit) { return 1.0 / (1.0 + std::exp(-logit)); };
  const auto [logit, of_share] = readings.likeliest(
      least_logit, most_logit,
      [&](double at, double z, double s) { return log_with_share(shape_, share_at(at), z, s); });
  one.kind = ChangeKind::outliers;
  one.size = share_at(logit);
  one.std_dev = std::sqrt(one.size * (1.0 - one.size) / N);
  offer(one, of_share);
  best.probability = 1.0 / all;
  alarm = best;
}

std::vector<double> ChangeDetector::state() const {
  std::vector<double> values{this_version, static_cast<double>(readings_), static_cast<double>(naming_left_),
                             static_cast<double>(open_.reading), static_cast<double>(open_.since)};
  for (const Chart& chart : charts_)
    for (const double value : {chart.ratio, chart.value, static_cast<double>(chart.since)})
      values.push_back(value);
  for (const Reading& one : since_)
    for (const double value : {one.true_m, one.reading_m, one.bearing_rad}) values.push_back(value);
  return values;
}

/// Of charts that watched for no outliers; false for a state that is none of theirs.
bool ChangeDetector::restore_earlier_version(const std::vector<double>& state) {
  const auto watched = static_cast<std::size_t>(std::count_if(
      charts_.begin(), charts_.end(), [](const Chart& c) { return c.kind != ChangeKind::outliers; }));
  const std::size_t sums = static_cast<std::size_t>((options_.bearings ? 5 : 3) + reference_.alpha.size());
  const bool first = state.size() == 4 + 4 * watched;
  if (!first && state.size() != 5 + 3 * watched + sums + sums * sums) return false;
  readings_ = whole_count(state[0]);
  naming_left_ = whole_count(state[1]) > 0 ? options_.naming : 0;
  open_.reading = whole_count(state[2]);
  open_.since = whole_count(state[3]);
  const double* next = state.data() + (first ? 4 : 5);
  for (std::size_t i = 0; i < watched; ++i) {
    Chart& chart = charts_[i];
    if (!first) {
      chart.ratio = sum_in(*next++);
      chart.value = sum_in(*next++);
    } else {
      chart.value = *next;
      chart.ratio = std::exp(std::clamp(chart.value, 0.0, 50.0));  // the largest of what R is the sum
      next += 3;
    }
    chart.since = whole_count(*next++);
  }
  return true;
}

void ChangeDetector::restore(const std::vector<double>& state) {
  if (!std::all_of(state.begin(), state.end(), [](double value) { return std::isfinite(value); }))
    throw InputError("ChangeDetector: the state has a number that is not finite");
  ChangeDetector restored(*this);
  restored.start_again();
  restored.open_ = {};
  const auto other_charts = [] { return InputError("ChangeDetector: the state is of other charts"); };
  if (state.empty()) throw other_charts();
  if (state[0] != this_version) {
    if (!restored.restore_earlier_version(state)) throw other_charts();
  } else {
    const std::size_t of_charts = 5 + 3 * charts_.size();
    if (state.size() < of_charts || (state.size() - of_charts) % 3 != 0) throw other_charts();
    const double* next = state.data() + 1;
    restored.readings_ = whole_count(*next++);
    restored.naming_left_ = whole_count(*next++);
    restored.open_.reading = whole_count(*next++);
    restored.open_.since = whole_count(*next++);
    for (Chart& chart : restored.charts_) {
      chart.ratio = sum_in(*next++);
      chart.value = sum_in(*next++);
      chart.since = whole_count(*next++);
    }
    for (std::size_t i = of_charts; i < state.size(); i += 3)
      restored.since_.push_back({state[i], state[i + 1], state[i + 2]});
    const auto taken = static_cast<std::int64_t>(restored.since_.size());
    if (restored.naming_left_ > 0 ? restored.naming_left_ + taken != options_.naming : taken > 0)
      throw InputError("ChangeDetector: the state names an alarm by more readings than are asked for");
    const ReadingsSince usable(reference_, density_, restored.since_);
    if (!usable.finite()) throw InputError("ChangeDetector: the state has a reading that was not taken");
  }
  *this = std::move(restored);
}

}  // namespace rangecal
