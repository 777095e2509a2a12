// SPDX-License-Identifier: BSD-3-Clause
#include "track/learner.hpp"

#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <unordered_map>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/json_fields.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/core/stops_io.hpp"
#include "rangecal/solvers/change/landmark_change_detector.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;

class PairsLearner : public Learner {
 public:
  PairsLearner(const TrackJob& job, const Columns& columns)
      : job_(job), timed_(columns.time >= 0), calibrator_(job.options) {}

  bool take(const StreamRow& row) override {
    if (!std::isfinite(row.true_m)) return false;
    calibrator_.add(row.true_m, row.reading_m, row.time_s);
    return true;
  }
  Calibration estimate() override {
    Calibration answer = job_.approximate ? calibrator_.approximate() : calibrator_.full();
    const double count = calibrator_.effective_readings();
    if (!is_usable(answer.outcome) && count < 0.5 * static_cast<double>(used()))  // all of them might do
      answer.reason += fmt::format("; with --forget {} ({}) they count as {:.3g}", job_.options.forget,
                                   timed_ ? "seconds of time_s" : "readings", count);
    return answer;
  }
  const Counts& counts() const override { return calibrator_.counts(); }
  std::int64_t used() const override { return calibrator_.used(); }
  double effective() const override { return calibrator_.effective_readings(); }
  std::int64_t first_estimate() const override { return calibrator_.options().order.value_or(1) + 3; }
  std::int64_t least_between() const override { return 1; }
  std::string to_json() const override { return calibrator_.to_json(); }
  void restore(const Json& state, const std::string& path) override {
    calibrator_ = RecursiveCalibrator::from_json(state.dump(), path);
    const RecursiveOptions &saved = calibrator_.options(), &now = job_.options;
    if (saved.order != now.order || saved.law != now.law || saved.forget != now.forget ||
        saved.range_min_m != now.range_min_m || saved.range_max_m != now.range_max_m ||
        saved.noise_shape != now.noise_shape)
      throw InputError(path + ": was made with another --order, --noise, --noise-shape, --forget or --range");
  }

 private:
  const TrackJob& job_;
  bool timed_;
  RecursiveCalibrator calibrator_;
};

class LandmarksLearner : public Learner {
 public:
  LandmarksLearner(const TrackJob& job, const Columns& columns)
      : known_(recording_of(job)), calibrator_(options_of(job, known_)), default_radius_m_(job.radius_m) {
    if (job.approximate)
      throw InputError("--approximate is for pairs; readings of landmarks are calibrated by marginal");
    if (!has_sigma(job.options.law))
      throw InputError(
          "--noise polynomial is for pairs; readings of landmarks have constant, f, f2, f3 or d2");
    if (known_) {
      know_stops();
    } else if (*std::min_element(columns.pose.begin(), columns.pose.end()) < 0) {
      throw InputError(
          "the stream has no columns x_m, y_m and heading_rad of the stops, and --stops names no recording");
    }
  }

  bool take(const StreamRow& row) override {
    outlier_.reset();
    if (row.stop.empty() || row.landmark.empty()) throw InputError("stop or landmark is missing");
    LandmarkReading reading;
    reading.landmark = row.landmark;
    reading.range_m = row.reading_m;
    reading.bearing_rad = row.bearing_rad;
    reading.stop = stop_of(row);
    if (calibrator_.options().random_walk && known_) pass_to(row.stop);
    reading.radius_m = std::isnan(row.radius_m) ? radius_of(row.landmark) : row.radius_m;
    if (std::abs(row.bearing_rad) > 2.0 * std::numbers::pi)
      throw InputError("bearing_rad is beyond 2 pi: degrees, most likely");
    alarm_.reset();
    if (known_ && (reading.range_m > known_->sensor.range_max_m ||
                   (reading.range_m > 0.0 && reading.range_m < known_->sensor.range_min_m))) {
      const bool above = reading.range_m > known_->sensor.range_max_m;
      calibrator_.drop(above ? "above range_max_m" : "below range_min_m");
      return true;
    }
    outlier_ = calibrator_.outlier_probability(reading);
    const bool usable = calibrator_.add(reading);
    if (!usable) outlier_.reset();
    if (usable && watch_) alarm_ = watch_->add(with_accuracy(reading));
    return true;
  }
  void watch(const Calibration& reference, const ChangeOptions& options) override {
    watch_.emplace(reference, calibrator_.options().random_walk, options);
  }
  std::optional<ChangeAlarm> alarm() const override { return alarm_; }
  std::string watch_state() const override { return watch_ ? watch_->to_json() : "null"; }
  void restore_watch(const std::string& state) override { watch_->restore(state); }
  Calibration estimate() override { return calibrator_.estimate(); }
  std::optional<double> outlier_probability() const override { return outlier_; }
  const Counts& counts() const override { return calibrator_.counts(); }
  std::int64_t used() const override { return calibrator_.used(); }
  std::int64_t stops_left_out() const override { return calibrator_.stops_left_out(); }
  double effective() const override {
    const double stops = static_cast<double>(std::max<std::int64_t>(1, calibrator_.stops()));
    return calibrator_.effective_stops() / stops * static_cast<double>(calibrator_.used());
  }
  std::int64_t first_estimate() const override { return 6; }
  /// One an estimate takes milliseconds: once a stop is often enough.
  std::int64_t least_between() const override {
    return calibrator_.used() / std::max<std::int64_t>(1, calibrator_.stops()) + 1;
  }
  std::string to_json() const override { return calibrator_.to_json(); }
  void restore(const Json& state, const std::string& path) override {
    const RecursiveLandmarksOptions now = calibrator_.options();
    calibrator_ = RecursiveLandmarks::from_json(state.dump(), path);
    const RecursiveLandmarksOptions& saved = calibrator_.options();
    if (saved.order != now.order || saved.law != now.law || saved.forget != now.forget ||
        saved.sigma_xy_m != now.sigma_xy_m || saved.sigma_heading_rad != now.sigma_heading_rad ||
        saved.random_walk != now.random_walk || saved.noise_shape != now.noise_shape)
      throw InputError(path +
                       ": was made with another --order, --noise, --noise-shape, --forget, --sigma-xy, "
                       "--sigma-heading or --random-walk");
  }
  Json stops_used() const override {
    if (!known_) return nullptr;
    std::string text = fmt::format("{} {}", known_->sensor.range_min_m, known_->sensor.range_max_m);
    for (const std::string& label : calibrator_.landmarks())
      text += fmt::format("\n{} {}", label, radius_of(label));
    return {{"count", used_stops_}, {"fingerprint", fmt::format("{:016x}", seed_from(text, {of_stops_}))}};
  }
  bool same_stops(const Json& saved) override {
    const auto count = whole_number<std::int64_t>(saved.at("count"), "stops.count");
    if (!known_ || count > static_cast<std::int64_t>(known_->stops.size())) return false;
    use_stops(static_cast<std::size_t>(count));
    return JsonFields::Read(stops_used()) == JsonFields::Read(saved);  // in whatever order
  }

 private:
  static std::optional<Recording> recording_of(const TrackJob& job) {
    if (job.stops.empty()) return std::nullopt;
    Recording recording = load_recording(job.stops);
    if (recording.kind != RecordingKind::landmarks)
      throw InputError(job.stops + ": is a recording of pairs, which has no stops");
    if (recording.estimate_sigma_xy)
      throw InputError(job.stops +
                       ": sigma_xy_m: estimate needs the whole recording; use 'rangecal calibrate " +
                       job.stops + " --method marginal'");
    recording.readings = {};
    return recording;
  }

  static RecursiveLandmarksOptions options_of(const TrackJob& job, const std::optional<Recording>& known) {
    RecursiveLandmarksOptions options;
    options.order = job.options.order;
    if (has_sigma(job.options.law)) options.law = job.options.law;  // refused below
    options.noise_shape = job.options.noise_shape;
    options.forget = job.options.forget;
    options.sigma_xy_m = job.sigma_xy_m;
    options.sigma_heading_rad = job.sigma_heading_rad;
    options.random_walk = job.random_walk || (known && known->stop_error == StopErrorModel::random_walk);
    // A walk that is summed up early is known too little for what comes after: most are shorter than this.
    if (options.random_walk) options.block = 64;
    if (options.random_walk && std::isfinite(options.forget))
      throw InputError(
          "--forget cannot be had along a random walk: the first stop alone tells where the landmarks are");
    // What is forgotten goes by blocks: at most half a time constant each.
    constexpr double fewest = 16.0;
    if (options.forget < fewest)
      throw InputError(
          fmt::format("--forget {}: of landmarks in unknown places at least {} stops are remembered",
                      options.forget, fewest));
    options.block = std::min(options.block, static_cast<int>(std::min(0.5 * options.forget, 1e4)));
    return options;
  }

  /// Accuracies, places in the order and radii by label.
  void know_stops() {
    for (std::size_t k = 0; k < known_->stops.size(); ++k) {
      Stop& stop = known_->stops[k];
      if (!stop.covariance) {
        stop.sigma_xy_m = sigma_xy_of(*known_, stop);
        stop.sigma_heading_rad = sigma_heading_of(*known_, stop);
      }
      number_[stop.label] = k;
    }
    for (const Landmark& landmark : known_->landmarks) radius_[landmark.label] = landmark.radius_m;
  }

  double radius_of(const std::string& landmark) const {
    const auto radius = radius_.find(landmark);
    return radius == radius_.end() ? default_radius_m_ : radius->second;
  }

  /// The first stops of the recording count; those behind them may still change, as it grows with the drive.
  void use_stops(std::size_t count) {
    for (; used_stops_ < count; ++used_stops_) {
      const Stop& stop = known_->stops[used_stops_];
      std::string text = fmt::format("{}\n{}\n{} {} {} {} {}", stop.label, stop.place, stop.commanded.x_m,
                                     stop.commanded.y_m, stop.commanded.heading_rad,
                                     stop.sigma_xy_m.value_or(-1.0), stop.sigma_heading_rad.value_or(-1.0));
      if (stop.covariance)
        for (const auto& entry : covariance_entries(*stop.covariance)) text += fmt::format(" {}", *entry);
      of_stops_ = seed_from(text, {of_stops_});
    }
  }

  /// The steps to stops from which nothing was read count too, in the order of the recording.
  void pass_to(const std::string& label) {
    const std::string last = calibrator_.last_stop();
    if (last == label) return;
    const std::size_t next = number_.at(label), begin = last.empty() ? 0 : number_.at(last) + 1;
    if (next < begin)
      throw InputError("stop '" + label + "' comes after stop '" + last + "', which " + known_->path +
                       " lists after it: a random walk goes in its order");
    for (std::size_t k = begin; k < next; ++k) {
      const Stop& stop = known_->stops[k];
      calibrator_.pass(stop);
      if (watch_) watch_->pass(stop);
    }
  }

  LandmarkReading with_accuracy(LandmarkReading reading) const {
    const RecursiveLandmarksOptions& options = calibrator_.options();
    if (!reading.stop.sigma_xy_m) reading.stop.sigma_xy_m = options.sigma_xy_m;
    if (!reading.stop.sigma_heading_rad) reading.stop.sigma_heading_rad = options.sigma_heading_rad;
    return reading;
  }

  Stop stop_of(const StreamRow& row) {
    Stop stop;
    if (known_) {
      const auto number = number_.find(row.stop);
      if (number == number_.end()) throw InputError("stop '" + row.stop + "' is not in " + known_->path);
      stop = known_->stops[number->second];
      use_stops(number->second + 1);
    }
    stop.label = row.stop;
    if (!row.place.empty()) stop.place = row.place;
    if (std::abs(row.pose[2]) > 2.0 * std::numbers::pi)
      throw InputError("heading_rad is beyond 2 pi: degrees, most likely");
    if (!std::isnan(row.pose[0])) stop.commanded = {row.pose[0], row.pose[1], row.pose[2]};
    if (!known_ && !(std::isfinite(row.pose[0]) && std::isfinite(row.pose[1]) && std::isfinite(row.pose[2])))
      throw InputError("the stop has no pose");
    if (!std::isnan(row.sigma_xy_m) || !std::isnan(row.sigma_heading_rad)) stop.covariance.reset();
    if (!std::isnan(row.sigma_xy_m)) stop.sigma_xy_m = row.sigma_xy_m;
    if (!std::isnan(row.sigma_heading_rad)) stop.sigma_heading_rad = row.sigma_heading_rad;
    CovarianceEntries entries;
    for (std::size_t i = 0; i < entries.size(); ++i)
      if (!std::isnan(row.covariance[i])) entries[i] = row.covariance[i];
    const StopCovariance covariance =
        stop_covariance(entries, stop.sigma_heading_rad.value_or(calibrator_.options().sigma_heading_rad));
    if (!covariance.fault.empty())
      throw InputError(std::string(covariance_columns[covariance.at]) + " " + covariance.fault);
    if (covariance.matrix) stop.covariance = covariance.matrix;
    return stop;
  }

  std::optional<Recording> known_;  ///< --stops, without its readings
  RecursiveLandmarks calibrator_;
  std::optional<LandmarkChangeDetector> watch_;
  std::optional<ChangeAlarm> alarm_;
  std::optional<double> outlier_;                        ///< of the last row taken
  std::unordered_map<std::string, std::size_t> number_;  ///< of a stop in the recording
  std::size_t used_stops_ = 0;
  std::uint64_t of_stops_ = 0;  ///< fingerprint of those
  std::unordered_map<std::string, double> radius_;
  double default_radius_m_;
};

/// What keeps an option from a stream of these columns; null: nothing.
const char* misplaced(const std::string& option, const Columns& columns) {
  const bool of_pairs = option == "--range";
  if (of_pairs != columns.landmarks()) return nullptr;
  if (of_pairs) return " limits true distances, which a stream of landmarks in unknown places does not have";
  return columns.truth >= 0
             ? " is for landmarks in unknown places, and the stream has true_m: its rows are pairs"
             : " is for readings of landmarks, and the stream has no columns stop and landmark";
}

}  // namespace

void Learner::watch(const Calibration&, const ChangeOptions&) {}
void Learner::restore_watch(const std::string&) {}

std::unique_ptr<Learner> make_learner(const TrackJob& job, const Columns& columns) {
  for (const std::string& option : job.given)
    if (const char* why = misplaced(option, columns)) throw InputError(option + why);
  if (columns.landmarks()) return std::make_unique<LandmarksLearner>(job, columns);
  return std::make_unique<PairsLearner>(job, columns);
}

}  // namespace rangecal::app
