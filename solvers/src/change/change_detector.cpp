// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/change_detector.hpp"

#include <fmt/format.h>

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

#include "change/over_range.hpp"
#include "change/wave.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

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
      break;
  }
  return 0.0;
}

double noise_step(double log_rho, double z) { return -log_rho + 0.5 * z * z * -std::expm1(-2.0 * log_rho); }

/// Of a power law; a polynomial's is taken as exact.
double variance_of_log_sigma(const Calibration& c) {
  if (c.noise.law == NoiseLaw::polynomial || c.noise_estimates.empty()) return 0.0;
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

constexpr double farthest_summed = 1e100;  // standard deviations: the squares of what is beyond have no sum

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
  if (naming < 10 || naming > 1000000) refuse(fmt::format("naming = {} is outside of 10 .. 1000000", naming));
}

ChangeDetector::ChangeDetector(const Calibration& reference, const ChangeOptions& options)
    : reference_(reference), options_(options) {
  options.check();
  if (!is_usable(reference.outcome) || reference.alpha.size() == 0 ||
      !(reference.range_max_m > reference.range_min_m))
    throw InputError("ChangeDetector: the calibration has no curve");
  if (!reference.effects.empty()) throw InputError("ChangeDetector: the calibration holds effects");
  for (const ChangeKind kind : {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing})
    add_charts(kind, 0);
  if (options_.bearings)
    for (const int wave : {0, 1}) add_charts(ChangeKind::encoder, wave);
  const double log_rho = std::log(options_.noise_factor);
  for (const double sign : {1.0, -1.0}) charts_.push_back({ChangeKind::noise, 0, sign * log_rho});
  start_again();
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
    sum_up(true_m, f, s, z, bearing_rad);
    if (--naming_left_ > 0) return std::nullopt;
    name(open_);
    start_again();
    return open_;
  }
  for (Chart& chart : charts_) {
    const double bg = chart.size * direction(chart.kind, chart.wave, f, s, bearing_rad);
    chart.step = chart.kind == ChangeKind::noise ? noise_step(chart.size, z) : bg * (z - 0.5 * bg);
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

void ChangeDetector::sum_up(double true_m, double f, double s, double z, double bearing) {
  Eigen::VectorXd h(score_.size());
  h.head<3>() << direction(ChangeKind::window, 0, f, s, 0.0), direction(ChangeKind::baseline, 0, f, s, 0.0),
      direction(ChangeKind::pointing, 0, f, s, 0.0);
  for (int wave = 0; options_.bearings && wave < 2; ++wave)
    h[3 + wave] = direction(ChangeKind::encoder, wave, f, s, bearing);
  h.tail(reference_.alpha.size()) = powers_of(true_m, reference_.alpha.size()) / s;
  score_ += h * z;
  information_ += h * h.transpose();
  squares_ += z * z;
}

void ChangeDetector::start_again() {
  for (Chart& chart : charts_) {
    chart.ratio = chart.before = chart.step = chart.value = 0.0;
    chart.since = readings_;
  }
  score_ = VectorXd::Zero(directions() + reference_.alpha.size());
  information_ = MatrixXd::Zero(score_.size(), score_.size());
  squares_ = 0.0;
}

void ChangeDetector::name(ChangeAlarm& alarm) const {
  const Index curve = reference_.alpha.size();
  const MatrixXd C = reference_.alpha_covariance.value_or(MatrixXd::Zero(curve, curve));
  const double N = options_.naming;
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
  constexpr ChangeKind plain[] = {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing};
  for (Index k = 0; k < 3; ++k) {
    const double U = score_[k], I = information_(k, k);
    if (!(I > 0.0)) continue;
    const VectorXd A = information_.row(k).tail(curve);
    one.kind = plain[k];
    one.size = U / I;
    one.std_dev = std::sqrt(1.0 / I + A.dot(C * A) / (I * I));
    offer(one, 0.5 * U * U / I);
  }
  const double v = std::max(squares_ / N, 1e-300);
  one.kind = ChangeKind::noise;
  one.size = 0.5 * std::log(v);
  one.std_dev = std::sqrt(0.5 / N + variance_of_log_sigma(reference_));
  offer(one, 0.5 * N * (v - 1.0 - std::log(v)));
  if (options_.bearings) {
    const Eigen::Matrix2d I = information_.block<2, 2>(3, 3);
    if (I.determinant() > 1e-9 * I(0, 0) * I(1, 1)) {  // else the bearings are all alike: an offset, too
      const Eigen::Vector2d U = score_.segment<2>(3);
      const Eigen::Matrix2d inverse = I.inverse();
      const Eigen::Matrix2Xd A = inverse * information_.block(3, directions(), 2, curve);
      tell_wave(inverse * U, inverse + A * C * A.transpose(), one);
      offer(one, 0.5 * U.dot(inverse * U) - 0.5 * std::log(N));
    }
  }
  best.probability = 1.0 / all;
  alarm = best;
}

std::vector<double> ChangeDetector::state() const {
  std::vector<double> values{static_cast<double>(readings_), static_cast<double>(naming_left_),
                             static_cast<double>(open_.reading), static_cast<double>(open_.since), squares_};
  for (const Chart& chart : charts_)
    for (const double value : {chart.ratio, chart.value, static_cast<double>(chart.since)})
      values.push_back(value);
  values.insert(values.end(), score_.begin(), score_.end());
  values.insert(values.end(), information_.data(), information_.data() + information_.size());
  return values;
}

void ChangeDetector::restore_first_version(const std::vector<double>& state) {
  if (naming_left_ > 0) naming_left_ = options_.naming;
  for (std::size_t i = 0; i < charts_.size(); ++i) {
    charts_[i].value = state[4 + 4 * i];
    charts_[i].ratio = std::exp(std::clamp(charts_[i].value, 0.0, 50.0));  // the largest of what R is the sum
    charts_[i].since = whole_count(state[7 + 4 * i]);
  }
}

void ChangeDetector::restore(const std::vector<double>& state) {
  const std::size_t charts = charts_.size(), sums = static_cast<std::size_t>(score_.size());
  const bool first_version = state.size() == 4 + 4 * charts;
  if (!first_version && state.size() != 5 + 3 * charts + sums + sums * sums)
    throw InputError("ChangeDetector: the state is of other charts");
  if (!std::all_of(state.begin(), state.end(), [](double value) { return std::isfinite(value); }))
    throw InputError("ChangeDetector: the state has a number that is not finite");
  ChangeDetector restored(*this);
  restored.start_again();
  restored.readings_ = whole_count(state[0]);
  restored.naming_left_ = whole_count(state[1]);
  restored.open_ = {};
  restored.open_.reading = whole_count(state[2]);
  restored.open_.since = whole_count(state[3]);
  if (first_version) {
    restored.restore_first_version(state);
  } else {
    const double* next = state.data() + 4;
    restored.squares_ = sum_in(*next++);
    for (Chart& chart : restored.charts_) {
      chart.ratio = sum_in(*next++);
      chart.value = sum_in(*next++);
      chart.since = whole_count(*next++);
    }
    for (double& value : restored.score_) value = *next++;
    std::copy_n(next, restored.information_.size(), restored.information_.data());
  }
  if (restored.naming_left_ > options_.naming)
    throw InputError("ChangeDetector: the state names an alarm by more readings than are asked for");
  *this = std::move(restored);
}

}  // namespace rangecal
