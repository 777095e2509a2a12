// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/change/landmark_change_detector.hpp"

#include <fmt/format.h>

#include <Eigen/Cholesky>
#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "change/landmark_watch.hpp"
#include "change/over_range.hpp"
#include "change/wave.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/stops_io.hpp"

namespace rangecal {
namespace {

using Eigen::Index;
using Eigen::Matrix3d;
using Eigen::VectorXd;

constexpr std::int64_t first_life = 32, longest_life = 512;  // stops

/// dy/db of the directions at a reading predicted as f.
std::array<double, LandmarkWatch::directions> slopes(double f, double bearing) {
  return {1.0, f, f * f, std::cos(bearing), std::sin(bearing)};
}

/// A stop is looked back at for longer the more twos its number holds.
std::int64_t life_of(std::int64_t stop) {
  std::int64_t life = first_life;
  for (; stop % 2 == 0 && life < longest_life; stop /= 2) life *= 2;
  return life;
}

/// Throws InputError naming the stop. What is not finite would spread through the filter and stay there.
void require_finite(const Stop& stop) {
  const std::string name = "LandmarkChangeDetector: stop '" + stop.label + "': ";
  for (const double value : {stop.commanded.x_m, stop.commanded.y_m, stop.commanded.heading_rad})
    if (!std::isfinite(value)) throw InputError(name + "its pose is not finite");
  for (const double value : {stop.sigma_xy_m.value_or(0.0), stop.sigma_heading_rad.value_or(0.0)})
    if (!(value >= 0.0 && std::isfinite(value)))
      throw InputError(name + "its accuracy is negative or not finite");
}

Matrix3d covariance_of_error(const Stop& stop) {
  if (stop.covariance) return checked_covariance(stop, "stop '" + stop.label + "'");
  const double xy = stop.sigma_xy_m.value_or(0.0), heading = stop.sigma_heading_rad.value_or(0.0);
  return Eigen::Vector3d(xy * xy, xy * xy, heading * heading).asDiagonal();
}

}  // namespace

auto LandmarkWatch::Onset::terms(const std::array<double, directions>& tau) const
    -> std::array<Term, directions + 2> {
  std::array<Term, directions + 2> all;
  for (std::size_t k = 0; k < directions; ++k) {
    const double grown = 1.0 + tau[k] * tau[k] * information[k];
    all[k] = {0.5 * tau[k] * tau[k] * score[k] * score[k] / grown, std::sqrt(grown)};
  }
  all[directions] = {log_up, 2.0};
  all[directions + 1] = {log_down, 2.0};
  return all;
}

double LandmarkWatch::Onset::ratio(const std::array<double, directions>& tau) const {
  double sum = 0.0;
  for (const Term& term : terms(tau)) sum += std::exp(term.exponent) / term.divisor;
  return sum / (directions + 1);
}

double LandmarkWatch::Onset::log_ratio(const std::array<double, directions>& tau) const {
  const auto all = terms(tau);
  double highest = all[0].exponent, sum = 0.0;
  for (const Term& term : all) highest = std::max(highest, term.exponent);
  for (const Term& term : all) sum += std::exp(term.exponent - highest) / term.divisor;
  return highest + std::log(sum / (directions + 1));
}

void LandmarkWatch::start(const Stop& stop) {
  require_finite(stop);
  const bool turned = !stop.place.empty() && stop.place == place && stops > 0;
  const bool follows = random_walk && stops > 0;
  const Matrix3d F = filter.start(stop.commanded, covariance_of_error(stop), follows, turned);
  for (Onset& onset : onsets)
    for (VectorXd& beta : onset.beta)
      beta.segment<3>(filter.pose()) = F * beta.segment<3>(filter.pose()).eval();
  label = stop.label;
  place = stop.place;
  ++stops;
  if (naming_left > 0) return;
  std::erase_if(onsets, [&](const Onset& onset) { return onset.until <= stops; });
  if (tested == opened_at) return;
  Onset onset;
  onset.since = readings;
  onset.until = stops + life_of(stops);
  onset.weight = static_cast<double>(tested - opened_at);
  for (VectorXd& beta : onset.beta) beta = VectorXd::Zero(filter.x.size());
  onsets.push_back(std::move(onset));
  opened_at = tested;
}

void LandmarkWatch::follow(Onset& onset, const LandmarkFilter::Taken& taken, double bearing) const {
  const auto slope = slopes(taken.f, bearing);
  if (taken.placed) {
    for (std::size_t k = 0; k < directions; ++k) {
      VectorXd& beta = onset.beta[k];
      const Eigen::Vector2d moved = taken.by_state * beta + slope[k] * taken.by_range;
      beta.conservativeResize(beta.size() + 2);
      beta.tail<2>() = moved;
    }
    return;
  }
  const LandmarkFilter::Innovation& range = taken.range;
  for (const LandmarkFilter::Innovation* read : {&taken.bearing, &range}) {
    std::array<double, directions> gamma{};
    for (std::size_t k = 0; k < directions; ++k) {
      gamma[k] = (read == &range ? slope[k] : 0.0) - read->row.dot(onset.beta[k]);
      onset.beta[k] += read->gain * gamma[k];
      onset.score[k] += gamma[k] * read->nu / read->S;
      onset.information[k] += gamma[k] * gamma[k] / read->S;
    }
    onset.cross += gamma[3] * gamma[4] / read->S;
  }
  const double share = range.noise / range.S, z_sq = range.nu * range.nu / range.S;
  const auto gain = [&](double factor) {  // of likelihood, the spread times factor
    const double grown = 1.0 + (factor * factor - 1.0) * share;
    return -0.5 * std::log(grown) + 0.5 * z_sq * (1.0 - 1.0 / grown);
  };
  onset.log_up += gain(options.noise_factor);
  onset.log_down += gain(1.0 / options.noise_factor);
  onset.spread_score += share * (z_sq - 1.0);
  onset.spread_information += share * share;
}

std::optional<ChangeAlarm> LandmarkWatch::add(const LandmarkReading& reading) {
  const double y = reading.range_m, bearing = reading.bearing_rad;
  if (!(y > 0.0) || !std::isfinite(y) || !std::isfinite(bearing)) return std::nullopt;
  if (!(reading.radius_m >= 0.0 && std::isfinite(reading.radius_m)))
    throw InputError("LandmarkChangeDetector: landmark '" + reading.landmark +
                     "': its radius is negative or not finite");
  if (stops == 0 || label != reading.stop.label) start(reading.stop);
  const LandmarkFilter::Taken taken = filter.take(reading.landmark, reading.radius_m, y, bearing);
  ++readings;
  if (!taken.usable) return std::nullopt;
  for (Onset& onset : onsets) follow(onset, taken, bearing);
  tested += !taken.placed;
  if (naming_left > 0) {
    if (--naming_left > 0) return std::nullopt;
    const Onset& onset = most_probable();
    open.since = onset.since;
    name(open, onset);
    onsets.clear();
    opened_at = tested;
    return open;
  }
  // R; infinite where a reading is some 50 standard deviations off: an alarm like any other
  double sum = 0.0;
  for (const Onset& onset : onsets) sum += onset.weight * onset.ratio(tau);
  if (!(sum > options.run_length)) return std::nullopt;
  open = {};
  open.reading = readings;
  open.since = most_probable().since;
  naming_left = options.naming;
  return open;
}

const LandmarkWatch::Onset& LandmarkWatch::most_probable() const {
  const Onset* best = &onsets.front();
  double largest = -std::numeric_limits<double>::infinity();
  for (const Onset& onset : onsets) {
    const double share = std::log(onset.weight) + onset.log_ratio(tau);
    if (!(share >= largest)) continue;
    largest = share;
    best = &onset;
  }
  return *best;
}

void LandmarkWatch::name(ChangeAlarm& alarm, const Onset& onset) {
  alarm.named = true;
  struct Answer {
    ChangeAlarm told;
    double gain;
    VectorXd done;           // beta b, what the change has done to the filter's state
    Eigen::MatrixXd unsure;  // beta cov(b) beta^T
  };
  std::vector<Answer> answers;
  ChangeAlarm one = alarm;
  constexpr ChangeKind plain[] = {ChangeKind::window, ChangeKind::baseline, ChangeKind::pointing};
  for (std::size_t k = 0; k < 3; ++k) {
    const double U = onset.score[k], I = onset.information[k];
    const VectorXd& beta = onset.beta[k];
    if (!(I > 0.0)) continue;
    one.kind = plain[k];
    one.size = U / I;
    one.std_dev = 1.0 / std::sqrt(I);
    answers.push_back({one, 0.5 * U * U / I, U / I * beta, beta * beta.transpose() / I});
  }
  Eigen::Matrix2d I;
  I << onset.information[3], onset.cross, onset.cross, onset.information[4];
  const Eigen::Vector2d U(onset.score[3], onset.score[4]);
  if (const Eigen::LLT<Eigen::Matrix2d> factor(I); factor.info() == Eigen::Success) {
    const Eigen::Vector2d wave = factor.solve(U);
    const Eigen::Matrix2d covariance = factor.solve(Eigen::Matrix2d::Identity());
    ChangeAlarm turning = alarm;
    tell_wave(wave, covariance, turning);
    Eigen::MatrixX2d beta(filter.x.size(), 2);
    beta << onset.beta[3], onset.beta[4];
    answers.push_back({turning, 0.5 * U.dot(wave) - 0.5 * std::log(static_cast<double>(options.naming)),
                       beta * wave, beta * covariance * beta.transpose()});
  }
  // the variance of one reading times 1 + q, by least squares of z^2 - 1 on its share of S
  const double N = onset.spread_information, v = std::max(1.0 + onset.spread_score / N, 1e-300);
  if (N > 0.0) {
    one.kind = ChangeKind::noise;
    one.size = 0.5 * std::log(v);
    one.std_dev = 1.0 / std::sqrt(2.0 * N);
    answers.push_back({one, 0.5 * N * (v - 1.0 - std::log(v)), {}, {}});
  }
  if (answers.empty()) return;
  const Answer& best = *std::max_element(answers.begin(), answers.end(),
                                         [](const Answer& a, const Answer& b) { return a.gain < b.gain; });
  alarm = best.told;
  double sum = 0.0;
  for (const Answer& answer : answers) sum += std::exp(answer.gain - best.gain);
  alarm.probability = 1.0 / sum;
  if (alarm.kind == ChangeKind::noise) return;
  filter.x -= best.done;
  filter.P += best.unsure;
}

LandmarkWatch::LandmarkWatch(const Calibration& reference, bool walk, const ChangeOptions& chosen)
    : filter(reference), options(chosen), random_walk(walk) {
  std::array<double, directions> sum{};
  over_range(reference, "LandmarkChangeDetector", [&](double f, double s) {
    // a wave is as large in the mean over a turn as over bearings of 45 degrees
    const auto slope = slopes(f, 0.25 * std::numbers::pi);
    for (std::size_t k = 0; k < directions; ++k) sum[k] += slope[k] * slope[k] / (s * s) / distances_of_range;
  });
  for (std::size_t k = 0; k < directions; ++k) tau[k] = options.shift / std::sqrt(sum[k]);
}

LandmarkChangeDetector::LandmarkChangeDetector(const Calibration& reference, bool random_walk,
                                               const ChangeOptions& options) {
  options.check();
  const auto refuse = [](const char* what) {
    throw InputError(std::string("LandmarkChangeDetector: ") + what);
  };
  if (!is_usable(reference.outcome) || reference.alpha.size() == 0 ||
      !(reference.range_max_m > reference.range_min_m))
    refuse("the calibration has no curve");
  if (!reference.sigma_theta_rad || !(reference.sigma_theta_rad->value > 0.0))
    refuse("the calibration does not say how bearings scatter (sigma_theta_rad); one made of landmarks does");
  if (!reference.effects.empty()) refuse("the calibration holds effects");
  watch_ = std::make_unique<LandmarkWatch>(reference, random_walk, options);
}
LandmarkChangeDetector::~LandmarkChangeDetector() = default;
LandmarkChangeDetector::LandmarkChangeDetector(LandmarkChangeDetector&&) noexcept = default;
LandmarkChangeDetector& LandmarkChangeDetector::operator=(LandmarkChangeDetector&&) noexcept = default;

std::optional<ChangeAlarm> LandmarkChangeDetector::add(const LandmarkReading& reading) {
  return watch_->add(reading);
}
void LandmarkChangeDetector::pass(const Stop& stop) {
  if (watch_->random_walk && watch_->label != stop.label) watch_->start(stop);
}
std::int64_t LandmarkChangeDetector::readings() const { return watch_->readings; }
std::string LandmarkChangeDetector::to_json() const { return state_of(*watch_); }
void LandmarkChangeDetector::restore(const std::string& json) { restore_watch(json, *watch_); }

}  // namespace rangecal
