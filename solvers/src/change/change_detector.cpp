// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/change_detector.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/random.hpp"

namespace rangecal {
namespace {

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

/// The limit of a chart of the spread: of simulated charts the average run length is (mean time of a cycle from 0 back to
/// 0) / (probability that a cycle passes h). The share of cycles that pass h falls as C e^-h, where C is taken at a
/// height that many cycles reach.
double noise_limit(double run_length, double log_rho) {
  constexpr int cycles = 40000;
  constexpr double height = 3.0;
  Random random(seed_from("cusum of the spread"));
  double readings = 0.0, passed = 0.0;
  for (int i = 0; i < cycles; ++i) {
    double S = 0.0;
    bool high = false;
    do {
      S += noise_step(log_rho, random.normal());
      readings += 1.0;
      high = high || S > height;
    } while (S > 0.0 && S < 60.0);
    passed += high;
  }
  return height + std::log(std::max(1.0, run_length * passed / readings));
}

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

double cusum_limit(double run_length, double D) {
  const auto log_length = [](double h) { return std::log(std::expm1(h) - h); };  // of (e^h - h - 1)
  double low = 1e-6, high = 100.0;
  const double wanted = std::log(run_length * D);
  for (int i = 0; i < 100; ++i) (log_length(0.5 * (low + high)) < wanted ? low : high) = 0.5 * (low + high);
  return std::max(0.1, 0.5 * (low + high) - 1.166 * std::sqrt(2.0 * D));
}

ChangeDetector::ChangeDetector(const Calibration& reference, const ChangeOptions& options)
    : reference_(reference), options_(options) {
  options.check();
  if (!is_usable(reference.outcome) || reference.alpha.size() == 0 ||
      !(reference.range_max_m > reference.range_min_m))
    throw InputError("ChangeDetector: the calibration has no curve");
  if (!reference.effects.empty()) throw InputError("ChangeDetector: the calibration holds effects");
  const auto add_chart = [&](ChangeKind kind, int wave) {
    double sum = 0.0;
    constexpr int points = 64;
    for (int i = 0; i < points; ++i) {
      const double d =
          reference_.range_min_m + (i + 0.5) / points * (reference_.range_max_m - reference_.range_min_m);
      const double f = evaluate_polynomial(reference_.alpha, d), s = reference_.noise.spread(d, f);
      if (!(s > 0.0))
        throw InputError("ChangeDetector: the calibration's noise is not positive over its range");
      // a wave is as large in the mean over a turn as over bearings of 45 degrees
      sum += std::pow(direction(kind, wave, f, s, 0.25 * std::numbers::pi), 2) / points;
    }
    const double size = options_.shift / std::sqrt(sum);
    for (const double sign : {1.0, -1.0}) charts_.push_back({kind, wave, sign * size, 0.0});
  };
  for (const ChangeKind kind : {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing})
    add_chart(kind, 0);
  if (options_.bearings)
    for (const int wave : {0, 1}) add_chart(ChangeKind::encoder, wave);
  const double log_rho = std::log(options_.noise_factor);
  for (const double sign : {1.0, -1.0}) charts_.push_back({ChangeKind::noise, 0, sign * log_rho, 0.0});
  const double each = options_.run_length * static_cast<double>(charts_.size());
  for (Chart& chart : charts_)
    chart.limit = chart.kind == ChangeKind::noise ? noise_limit(each, chart.size)
                                                  : cusum_limit(each, 0.5 * options_.shift * options_.shift);
}

std::optional<ChangeAlarm> ChangeDetector::add(double true_m, double reading_m, double bearing_rad) {
  if (!(reading_m > 0.0) || !std::isfinite(reading_m) || !std::isfinite(true_m) ||
      !std::isfinite(bearing_rad))
    return std::nullopt;
  const double f = evaluate_polynomial(reference_.alpha, true_m), s = reference_.noise.spread(true_m, f);
  if (!(s > 0.0)) return std::nullopt;
  const double z = (reading_m - f) / s;
  ++readings_;
  const Chart* worst = nullptr;
  for (Chart& chart : charts_) {
    const bool noise = chart.kind == ChangeKind::noise;
    const double g = direction(chart.kind, chart.wave, f, s, bearing_rad);
    if (naming_left_ > 0) {
      chart.score += noise ? z * z : g * z;
      chart.information += noise ? 1.0 : g * g;
      continue;
    }
    chart.value += noise ? noise_step(chart.size, z) : chart.size * g * (z - 0.5 * chart.size * g);
    if (chart.value <= 0.0) {
      chart.value = 0.0;
      chart.since = readings_;
    }
    if (chart.value > chart.limit && (!worst || chart.value - chart.limit > worst->value - worst->limit))
      worst = &chart;
  }
  if (naming_left_ > 0) {
    if (--naming_left_ > 0) return std::nullopt;
    name(open_);
    start_again();
    return open_;
  }
  if (!worst) return std::nullopt;
  open_ = {};
  open_.reading = readings_;
  open_.since = worst->since;
  naming_left_ = options_.naming;
  return open_;
}

void ChangeDetector::start_again() {
  for (Chart& chart : charts_) {
    chart.value = chart.score = chart.information = 0.0;
    chart.since = readings_;
  }
}

void ChangeDetector::name(ChangeAlarm& alarm) const {
  alarm.named = true;
  double best = -1.0;
  std::vector<double> gains;
  for (std::size_t i = 0; i < charts_.size(); i += 2) {  // both signs have the same sums
    const Chart& chart = charts_[i];
    if (chart.kind == ChangeKind::encoder && chart.wave == 1) continue;
    double gain = 0.0, size = 0.0, std_dev = 0.0;
    if (chart.kind == ChangeKind::noise) {
      const double v = std::max(chart.score / chart.information, 1e-300);
      gain = 0.5 * chart.information * (v - 1.0 - std::log(v));
      size = 0.5 * std::log(v);
      std_dev = 1.0 / std::sqrt(2.0 * chart.information);
    } else if (chart.information > 0.0) {
      gain = 0.5 * chart.score * chart.score / chart.information;
      size = chart.score / chart.information;
      std_dev = 1.0 / std::sqrt(chart.information);
      if (chart.kind == ChangeKind::encoder) {
        const Chart& sine = charts_[i + 2];
        gain += sine.information > 0.0 ? 0.5 * sine.score * sine.score / sine.information : 0.0;
        gain -= 0.5 * std::log(static_cast<double>(options_.naming));
        size = std::hypot(size, sine.information > 0.0 ? sine.score / sine.information : 0.0);
      }
    }
    gains.push_back(gain);
    if (gain <= best) continue;
    best = gain;
    alarm.kind = chart.kind;
    alarm.size = size;
    alarm.std_dev = std_dev;
  }
  double sum = 0.0;
  for (const double gain : gains) sum += std::exp(gain - best);
  alarm.probability = 1.0 / sum;
}

std::vector<double> ChangeDetector::state() const {
  std::vector<double> values{static_cast<double>(readings_), static_cast<double>(naming_left_),
                             static_cast<double>(open_.reading), static_cast<double>(open_.since)};
  for (const Chart& chart : charts_)
    for (const double value : {chart.value, chart.score, chart.information, static_cast<double>(chart.since)})
      values.push_back(value);
  return values;
}

void ChangeDetector::restore(const std::vector<double>& state) {
  if (state.size() != 4 + 4 * charts_.size())
    throw InputError("ChangeDetector: the state is of other charts");
  const auto count = [](double value) {
    if (!(value >= 0.0 && value < 0x1p53))
      throw InputError("ChangeDetector: the state counts what cannot be counted");
    return static_cast<std::int64_t>(value);
  };
  readings_ = count(state[0]);
  naming_left_ = count(state[1]);
  open_ = {};
  open_.reading = count(state[2]);
  open_.since = count(state[3]);
  for (std::size_t i = 0; i < charts_.size(); ++i) {
    charts_[i].value = state[4 + 4 * i];
    charts_[i].score = state[5 + 4 * i];
    charts_[i].information = state[6 + 4 * i];
    charts_[i].since = count(state[7 + 4 * i]);
  }
}

}  // namespace rangecal
