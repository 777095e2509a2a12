// SPDX-License-Identifier: BSD-3-Clause
#include "everyday.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/quantiles.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal::proof {
namespace {

/// A table in the making: the pairs, what the readings would be without noise, and how strong a cause may be.
class Draft {
 public:
  Draft(std::string kind, std::uint64_t seed) : random_(seed_from("everyday " + kind, {seed})) {
    table_.kind = std::move(kind);
    table_.recording.kind = RecordingKind::pairs;
    const std::size_t rows = 400 + random_.index(401);
    const double far = random_.uniform(4.0, 10.0);
    table_.alpha = {random_.normal(0.0, 0.03), random_.normal(1.0, 0.02), random_.normal(0.0, 0.003)};
    noise_ = log_uniform(0.0008, 0.004);
    Pairs& pairs = table_.recording.pairs;
    for (std::size_t i = 0; i < rows; ++i) {
      pairs.true_m.push_back(random_.uniform(0.3, far));
      f_.push_back(evaluate_polynomial(table_.alpha, pairs.true_m.back()));
      pairs.reading_m.push_back(f_.back() + noise_ * f_.back() * f_.back() * random_.normal());
      pairs.row.push_back(static_cast<int>(i) + 2);
    }
    std::vector<double> sorted = f_;
    std::nth_element(sorted.begin(), sorted.begin() + static_cast<std::ptrdiff_t>(rows / 2), sorted.end());
    median_noise_ = noise_ * std::pow(sorted[rows / 2], 2);
  }

  std::size_t size() const { return f_.size(); }
  const std::vector<double>& f() const { return f_; }
  const std::vector<double>& distances() const { return table_.recording.pairs.true_m; }
  double uniform(double low, double high) { return random_.uniform(low, high); }
  bool happens(double probability) { return random_.uniform() < probability; }
  double normal(double sigma) { return random_.normal(0.0, sigma); }
  double exponential(double mean) { return -mean * std::log1p(-random_.uniform()); }

  /// Change of a reading by a cause [m], of either sign.
  double strength(double least = 0.4) {
    return (happens(0.5) ? -1.0 : 1.0) * median_noise_ * log_uniform(least, 2.0);
  }
  double mean_f() const { return mean(f_); }

  /// A column of values between two limits, of each one's own or slowly up and down; returned with mean 0 and spread 1.
  std::vector<double> column(const std::string& name, double low, double high, bool slowly = false) {
    std::vector<double>& values = table_.recording.pairs.covariates[name];
    const double phase = random_.uniform(0.0, 6.0), middle = 0.5 * (low + high), half = 0.5 * (high - low);
    for (std::size_t i = 0; i < size(); ++i) {
      const double turn = phase + 5.0 * static_cast<double>(i) / static_cast<double>(size());
      values.push_back(slowly ? middle + 0.8 * half * std::sin(turn) + random_.normal(0.0, 0.02 * half)
                              : random_.uniform(low, high));
    }
    return standardised(values);
  }
  std::vector<double> given_column(const std::string& name, std::vector<double> values) {
    return standardised(table_.recording.pairs.covariates[name] = std::move(values));
  }

  template <typename Change>
  void add(const Change& change) {
    for (std::size_t i = 0; i < size(); ++i) readings()[i] += change(i);
  }
  /// Outliers too far, or too near for a negative sign, exponential beyond the reading.
  void add_outliers(double share, double sign) {
    const double beyond = uniform(0.1, 0.5);
    for (double& reading : readings())
      if (happens(share)) reading = std::max(0.05, reading + sign * exponential(beyond));
  }
  std::vector<double>& readings() { return table_.recording.pairs.reading_m; }

  EverydayTable finish(std::vector<std::vector<std::string>> causes, bool level_is_alpha_0 = false) {
    table_.causes = std::move(causes);
    table_.level_is_alpha_0 = level_is_alpha_0;
    table_.recording.counts.read = table_.recording.counts.used = static_cast<int>(size());
    return std::move(table_);
  }
  Recording& recording() { return table_.recording; }

 private:
  double log_uniform(double low, double high) {
    return std::exp(random_.uniform(std::log(low), std::log(high)));
  }
  static double mean(const std::vector<double>& values) {
    return Eigen::Map<const Eigen::ArrayXd>(values.data(), static_cast<Eigen::Index>(values.size())).mean();
  }
  static std::vector<double> standardised(std::vector<double> values) {
    const double middle = mean(values);
    double squares = 0.0;
    for (double& value : values) squares += std::pow(value -= middle, 2);
    for (double& value : values) value /= std::sqrt(squares / static_cast<double>(values.size()));
    return values;
  }

  EverydayTable table_;
  Random random_;
  std::vector<double> f_;
  double noise_ = 0.0, median_noise_ = 0.0;
};

constexpr double room_low_c = 5.0, room_high_c = 40.0;

/// In half of the tables the temperature follows the day, in the others it is another for each reading.
std::vector<double> temperature(Draft& draft) {
  return draft.column("temperature_c", room_low_c, room_high_c, draft.happens(0.5));
}

void add_proportional(Draft& draft, const std::vector<double>& z) {
  const double strength = draft.strength();
  draft.add([&](std::size_t i) { return strength * z[i]; });
}

void add_times_range(Draft& draft, const std::vector<double>& z, double strength) {
  draft.add([&](std::size_t i) { return strength * z[i] * draft.f()[i] / draft.mean_f(); });
}

std::vector<double> each(const std::vector<double>& from, const auto& value) {
  std::vector<double> to;
  for (const double x : from) to.push_back(value(x));
  return to;
}

const std::vector<std::string> of_temperature{"temperature_coefficient"}, of_column{"covariate_drift"};

EverydayTable two_devices(Draft& draft) {
  Recording& recording = draft.recording();
  recording.landmarks = {{"A", 0.0, {}}, {"B", 0.0, {}}};
  Pairs& pairs = recording.pairs;
  for (std::size_t i = 0; i < draft.size(); ++i) {
    pairs.landmark.push_back(draft.happens(0.5) ? 1 : 0);
    pairs.time_s.push_back(2.0 * static_cast<double>(i));
  }
  const double apart = draft.strength(0.6), cold = draft.strength(0.6),
               warm_s = draft.uniform(0.1, 0.4) * pairs.time_s.back();
  draft.add(
      [&](std::size_t i) { return apart * pairs.landmark[i] + cold * std::exp(-pairs.time_s[i] / warm_s); });
  return draft.finish({{"device_offset", "target_reflectance"}, {"warmup_drift"}});
}

EverydayTable reciprocal(Draft& draft) {
  temperature(draft);
  const double a = draft.uniform(0.0, 0.5), b = draft.uniform(2.0, 8.0), c = draft.uniform(0.1, 0.6);
  for (std::size_t i = 0; i < draft.size(); ++i)
    draft.readings()[i] = a + b / (draft.distances()[i] + c) + draft.normal(0.01);
  return draft.finish({});
}

/// Of f at three distances, by the calibration's covariance with the effects' parameters free.
Coverage coverage_of_curve(const EverydayTable& table, const Calibration& c) {
  Coverage out;
  if (!table.level_is_alpha_0 || !c.effects_covariance || c.alpha.size() != 3) return out;
  const Eigen::Matrix3d C = c.effects_covariance->matrix.topLeftCorner<3, 3>();
  for (const double share : {0.1, 0.5, 0.9}) {
    const double d = c.range_min_m + share * (c.range_max_m - c.range_min_m);
    const Eigen::Vector3d p(1.0, d, d * d);
    ++out.intervals;
    out.covered += std::abs(p.dot(c.alpha - table.alpha)) < z95 * std::sqrt(p.dot(C * p));
  }
  return out;
}

}  // namespace

const std::vector<std::string>& everyday_kinds() {
  static const std::vector<std::string> kinds{"temperature",
                                              "temperature-scale",
                                              "supply-voltage",
                                              "received-power",
                                              "humidity",
                                              "dust",
                                              "two-devices",
                                              "periodic-late",
                                              "temperature-early",
                                              "temperature-rounded",
                                              "temperature-voltage",
                                              "reciprocal"};
  return kinds;
}

EverydayTable draw_everyday(const std::string& kind, std::uint64_t seed) {
  Draft draft(kind, seed);
  if (kind == "temperature") {
    add_proportional(draft, temperature(draft));
    return draft.finish({of_temperature}, true);
  }
  if (kind == "temperature-scale") {
    add_times_range(draft, temperature(draft), draft.strength());
    // range_scale counts from 20 C: its curve is that at another temperature.
    return draft.finish({{"temperature_coefficient", "range_scale"}});
  }
  if (kind == "supply-voltage") {
    const std::vector<double> z = draft.column("supply_v", 4.4, 5.6);
    const double strength = draft.strength();
    draft.add([&](std::size_t i) { return strength * z[i] * z[i]; });
    return draft.finish({of_column});
  }
  if (kind == "received-power") {  // falls with distance by 20 dB a decade
    add_proportional(draft, draft.given_column("rx_power_dbm", each(draft.distances(), [&](double d) {
                                                 return -60.0 - 20.0 * std::log10(d) + draft.normal(4.0);
                                               })));
    return draft.finish({{"power_bias"}});
  }
  if (kind == "humidity") {
    add_proportional(draft, draft.column("humidity_percent", 20.0, 90.0));
    return draft.finish({of_column}, true);
  }
  if (kind == "dust") {  // weighed in four portions
    const std::vector<double> z =
        draft.given_column("dust_g", each(draft.distances(), [&](double) {
                             constexpr double portions[] = {0.0, 0.2, 0.5, 1.0};
                             return portions[static_cast<std::size_t>(draft.uniform(0.0, 4.0))];
                           }));
    add_times_range(draft, z, -std::abs(draft.strength()));
    return draft.finish({of_column}, true);
  }
  if (kind == "two-devices") return two_devices(draft);
  if (kind == "periodic-late") {
    const double strength = draft.strength(0.6), period = draft.uniform(0.3, 2.0);
    draft.add([&](std::size_t i) {
      return strength * std::sin(2.0 * std::numbers::pi * draft.distances()[i] / period);
    });
    draft.add_outliers(0.08, 1.0);
    return draft.finish({{"cyclic_error"}, {"late_return"}});
  }
  if (kind == "temperature-early") {
    add_proportional(draft, temperature(draft));
    draft.add_outliers(0.06, -1.0);
    return draft.finish({of_temperature, {"early_echo"}}, true);
  }
  if (kind == "temperature-rounded") {
    add_proportional(draft, temperature(draft));
    for (double& reading : draft.readings()) reading = std::max(0.01, std::round(100.0 * reading) / 100.0);
    return draft.finish({of_temperature, {"quantisation"}}, true);
  }
  if (kind == "temperature-voltage") {
    add_proportional(draft, temperature(draft));
    add_proportional(draft, draft.column("supply_v", 4.4, 5.6));
    return draft.finish({of_temperature, of_column}, true);
  }
  if (kind == "reciprocal") return reciprocal(draft);
  throw InputError("no everyday table is of the kind '" + kind + "'");
}

Score score_everyday(const EverydayTable& table, const Diagnosis& diagnosis) {
  Score out;
  out.row = "everyday";
  out.planted = table.kind;
  out.causes = static_cast<int>(table.causes.size());
  const std::vector<std::vector<std::string>> sets = answer_sets(diagnosis);
  out.answer = in_words(sets);
  out.set_size = static_cast<int>(sets.size());
  out.alarm_p = diagnosis.alarm_p_value;
  if (!diagnosis.explanations.empty()) out.probability = diagnosis.explanations[0].probability;
  const auto named_in = [](const std::vector<std::vector<std::string>>& causes, const std::string& id) {
    return std::find_if(causes.begin(), causes.end(), [&](const std::vector<std::string>& names) {
      return std::find(names.begin(), names.end(), id_without_column(id)) != names.end();
    });
  };
  out.probabilities = probabilities_of(
      diagnosis, [&](const std::string& id) { return named_in(table.causes, id) != table.causes.end(); });
  std::vector<std::vector<std::string>> left = table.causes;
  for (const std::string& id : sets.empty() ? std::vector<std::string>{} : sets.front()) {
    const auto cause = named_in(left, id);
    if (cause == left.end())
      out.names.wrong += id != "generic";
    else
      ++out.names.found, left.erase(cause);
  }
  const bool quiet = diagnosis.verdict == Verdict::no_mismatch;
  if (table.causes.empty())
    out.result = quiet ? Answer::quiet : Answer::false_alarm;
  else if (quiet)
    out.result = Answer::missed;
  else if (out.names.wrong > 0)
    out.result = Answer::wrong_name;
  else
    out.result =
        left.empty() && diagnosis.verdict == Verdict::explained ? Answer::right_name : Answer::unexplained;
  if (out.result == Answer::right_name) out.coverage = coverage_of_curve(table, diagnosis.corrected);
  if (diagnosis.before.heldout_nll && diagnosis.after.heldout_nll)
    out.held_out_improves = *diagnosis.after.heldout_nll < *diagnosis.before.heldout_nll;
  return out;
}

}  // namespace rangecal::proof
