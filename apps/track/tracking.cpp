// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking.hpp"

#include <fmt/core.h>
#include <signal.h>

#include <chrono>
#include <cmath>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/polynomial.hpp"
#include "rangecal/core/write_lock.hpp"
#include "rangecal/problems/noise_shape.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "track/learner.hpp"
#include "track/line_source.hpp"
#include "track/output.hpp"
#include "track/saved_calibration.hpp"
#include "track/state.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;
constexpr int most_complaints = 10;
constexpr std::size_t most_changes = 1000;  // kept, the latest

volatile sig_atomic_t stopped = 0;  // by which signal
void stop(int signal) { stopped = signal; }

class Run {
 public:
  explicit Run(const TrackJob& job)
      : job_(job), name_(job.input == "-" ? "stdin" : job.input), output_(job.output) {
    if (!job.from.empty()) {
      given_ = load_calibration(job.from);
      require_curve(*given_, job.from);
      require_polynomial(*given_, job.from);
      if (!given_->effects.empty())
        throw InputError(job.from + ": holds effects, which a stream cannot undo; use 'rangecal correct'");
    }
    if (job.watch > 0.0) {
      if (!given_) throw InputError("--watch needs --from, the calibration that may have changed");
    } else if (!job.changes.empty()) {
      throw InputError("--changes needs --watch");
    }
    for (const std::string& path : {job.state, job.output})
      if (!path.empty() && (!file_exists(path) || std::filesystem::is_regular_file(path)))
        locks_.push_back(std::make_unique<WriteLock>(path));
    resumed_ = !job.state.empty() && file_exists(job.state);
    if (resumed_) load();
    source_ = std::make_unique<LineSource>(job.input);
    if (resumed_) go_on();
    // Of a new stream only when its columns are known: a wrong file leaves what was there.
    if (learner_) output_.open(state_.output_bytes, state_.tells_outliers);
    write_changes();  // a table without alarms is one, and none of an earlier run is left
  }

  Tracked run() {
    struct sigaction action {};
    action.sa_handler = stop;
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    if (state_.calibration)
      correct_by(*state_.calibration);
    else if (given_)
      correct_by(*given_);
    read_all();
    const int signal = stopped;
    if (signal == 0 && source_->has_rest()) {
      if (job_.follow || (!job_.state.empty() && job_.input != "-"))
        notes_.push_back(name_ + ": the last line has no end yet and was left for the next run");
      else
        take(source_->rest());
    }
    if (!learner_ && signal == 0) throw InputError(name_, 0, "", "holds no reading");
    save();
    Tracked result;
    result.rows = state_.rows;
    result.corrected = state_.corrected;
    result.out_of_range = state_.out_of_range;
    result.malformed = state_.malformed;
    result.landmarks = columns_.landmarks();
    result.timed = columns_.time >= 0;
    result.changes = state_.changes;
    if (learner_) {
      if (learner_->counts().read > 0) result.calibration = learner_->estimate();
      result.counts = learner_->counts();
      result.effective = learner_->effective();
      if (const std::int64_t stops = learner_->stops_left_out(); stops > 0)
        notes_.push_back(
            fmt::format("{}: {} stops have no optimum beside the others and were left out; calibrate the "
                        "recording as a whole",
                        name_, stops));
    }
    result.notes = notes_;
    if (state_.malformed > most_complaints)
      result.notes.push_back(fmt::format("{}: {} rows were not understood in all", name_, state_.malformed));
    result.lost = lost_;
    result.stopped_by = signal;
    return result;
  }

 private:
  void read_all() {
    std::string line;
    bool idle = false;
    while (!stopped) {
      const LineSource::Status status = source_->next(line);
      if (status == LineSource::Status::line) {
        idle = false;
        take(line);
      } else if (status == LineSource::Status::end) {
        if (!job_.follow || job_.input == "-" || !lost_.empty()) return;
        lost_ = source_->lost();
        if (!lost_.empty()) continue;  // what was written before that is still there
        if (!idle) save();
        idle = true;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
      }
    }
  }

  void load() {
    const std::string& path = job_.state;
    try {
      state_ = state_in(read_file(path, std::size_t{64} << 20));
      if (!state_.header.empty()) columns_ = columns_of(state_.header, name_, 0);
      if (const Json now = asked(); state_.asked.is_object())
        for (const auto& [option, value] : now.items())
          if (state_.asked.value(option, value) != value)  // those of an earlier version lack some
            throw InputError(path + ": was made with another --" + option);
      if (!state_.header.empty() || state_.calibrator.is_object()) {
        begin();
        learner_->restore(state_.calibrator, path);
      }
      if (state_.watch.is_null() == watching_)
        throw InputError(path + ": was made with or without --watch, now it is otherwise");
      if (detector_)
        detector_->restore(state_.watch.get<std::vector<double>>());
      else if (watching_)
        learner_->restore_watch(state_.watch.dump());
      same_stops_ = !learner_ || !state_.stops.is_object() || learner_->same_stops(state_.stops);
    } catch (const Json::exception& error) {
      throw InputError(path, 0, "", "is no state of 'rangecal track': " + json_complaint(error));
    } catch (const InputError& error) {
      const std::string what = error.what();
      throw what.starts_with(path) ? error : InputError(path, 0, "", what);
    }
  }

  [[noreturn]] void refuse(const std::string& why) const {
    throw InputError(name_, 0, "", "is another stream than the state's (" + why + ")");
  }

  /// To where the state ends. A file is read again up to there: only so it is known to be the same.
  void go_on() {
    if (!same_stops_) refuse("what it used of " + job_.stops + " has changed");
    if (!source_->begins_anew()) {
      state_.line = 0;
      return;
    }
    const std::int64_t end = state_.offset;
    std::string line, first;
    while (source_->offset() < end && source_->next(line) == LineSource::Status::line)
      if (is_blank(first)) first = line;
    if (const std::string& header = state_.header; !header.empty() && header != first)
      refuse("its header is '" + first + "', not '" + header + "'");
    if (source_->offset() < end) refuse(fmt::format("it has less than the {} bytes that were read", end));
    if (source_->offset() > end ||
        (!state_.fingerprint.empty() && state_.fingerprint != source_->fingerprint()))
      refuse(fmt::format("its first {} bytes are not those that were read", end));
  }

  /// What was asked for that decides what comes out, and that the calibrator does not keep.
  Json asked() const {
    return {{"from", given_ ? fingerprint_of(*given_) : ""},
            {"watch", job_.watch},
            {"radius", job_.radius_m},
            {"stops", !job_.stops.empty()},
            {"approximate", job_.approximate}};
  }

  void save() {
    output_.flush();
    if (job_.state.empty()) return;
    state_.output_bytes = output_.bytes();
    state_.offset = source_->offset();
    state_.fingerprint = source_->fingerprint();
    state_.asked = asked();
    if (learner_) {
      state_.stops = learner_->stops_used();
      state_.watch = detector_ ? Json(detector_->state()) : Json::parse(learner_->watch_state());
      state_.calibrator = Json::parse(learner_->to_json());
    }
    write_file(job_.state, to_json(state_));
  }

  void complain(const std::string& column, const std::string& what) {
    if (++state_.malformed <= most_complaints)
      notes_.push_back(InputError(name_, static_cast<long>(state_.line), column, what).what());
    output_.print(state_.tells_outliers ? ",,,malformed,\n" : ",,,malformed\n");
  }

  static bool is_blank(const std::string& line) { return line.find_first_not_of(" \t") == std::string::npos; }

  void take(const std::string& line) {
    const auto number = static_cast<long>(++state_.line);
    if (is_blank(line)) return;
    if (!learner_) {
      const bool named = !number_of(line);
      if (named) {
        state_.header = line;
        columns_ = columns_of(line, name_, number);
      }
      begin();
      write_changes();
      output_.open(state_.output_bytes, state_.tells_outliers);
      if (named) return;
    } else if (!source_->begins_anew() && names_columns(line)) {  // the same program started again
      if (columns_of(line, name_, number) == columns_) return;
      if (resumed_) refuse("its header is '" + line + "', not '" + state_.header + "'");
      throw InputError(name_, number, "", "names other columns than the header before");
    }
    ++state_.rows;
    take_row(line);
    if (state_.rows % job_.every == 0) save();
  }

  void take_row(const std::string& line) {
    const auto fields = csv_fields(line);
    if (!fields) return complain("", "a quote is left open");
    if (fields->size() != columns_.count)
      return complain("",
                      fmt::format("has {} fields where the header has {}", fields->size(), columns_.count));
    StreamRow row;
    if (const BadField bad = read_row(columns_, *fields, row); !bad.what.empty())
      return complain(bad.column, bad.what);
    if (columns_.time >= 0 && !std::isfinite(row.time_s)) return complain("time_s", "there is no time");
    if (detector_ && std::isfinite(row.true_m)) watch(row);
    std::optional<double> outlier = outlier_probability(row);
    try {
      const bool taken = learner_->take(row);
      if (const auto of_landmark = learner_->outlier_probability(); taken && of_landmark)
        outlier = of_landmark;
      if (const auto alarm = learner_->alarm(); taken && alarm) note(*alarm);
      if (taken && learner_->used() >= state_.next_estimate) estimate();
    } catch (const InputError& error) {
      if (!columns_.landmarks()) throw;
      return complain("", error.what());
    }
    correct_reading(row.reading_m, outlier);
  }

  /// The columns are known: what learns from them, and what watches them.
  void begin() {
    learner_ = make_learner(job_, columns_);
    watching_ = job_.watch > 0.0;
    if (!watching_) return;
    ChangeOptions watch;
    watch.run_length = job_.watch;
    watch.bearings = columns_.bearing >= 0;
    if (!columns_.landmarks()) {
      detector_.emplace(*given_, watch);
    } else {
      if (!given_->sigma_theta_rad)
        throw InputError(
            job_.from +
            ": does not say how bearings scatter (sigma_theta_rad), which --watch needs for readings of "
            "landmarks; a calibration made of landmarks does");
      learner_->watch(*given_, watch);
    }
  }

  /// The calibration so far, and when to look again: after 2 % more pairs of those that count, of noise that is not Gaussian
  /// 5 %.
  void estimate() {
    if (learner_->used() >= learner_->first_estimate()) {
      Calibration now = learner_->estimate();
      if (now.outcome == Outcome::converged && now.alpha_covariance && now.range_max_m > now.range_min_m) {
        state_.calibration = std::move(now);
        correct_by(*state_.calibration);
      }
    }
    const bool shaped = state_.calibration && !state_.calibration->noise_shapes.empty();
    const double growth = shaped && !columns_.landmarks() ? 0.05 : 0.02;
    state_.next_estimate =
        learner_->used() +
        std::max(learner_->least_between(), static_cast<std::int64_t>(growth * learner_->effective()));
  }

  void watch(const StreamRow& row) {
    const auto alarm =
        detector_->add(row.true_m, row.reading_m, columns_.bearing >= 0 ? row.bearing_rad : 0.0);
    if (alarm) note(*alarm);
  }

  void note(const ChangeAlarm& alarm) {
    std::vector<ChangeAlarm>& changes = state_.changes;
    if (alarm.named && !changes.empty())
      changes.back() = alarm;
    else
      changes.push_back(alarm);
    if (changes.size() > most_changes) changes.erase(changes.begin());
    write_changes();
  }

  void write_changes() const {
    if (!job_.changes.empty()) write_file(job_.changes, table_of(state_.changes, columns_.landmarks()));
  }

  void correct_by(const Calibration& calibration) {
    corrector_.emplace(calibration, std::vector<std::string>{});
    density_.emplace(noise_shape_of(calibration, "range"));
  }

  /// That the row's reading is an outlier, by the calibration before it; none where no distance is known.
  std::optional<double> outlier_probability(const StreamRow& row) const {
    if (!density_ || !std::isfinite(row.true_m) || !std::isfinite(row.reading_m)) return std::nullopt;
    const Calibration& known = state_.calibration ? *state_.calibration : *given_;
    const double f = evaluate_polynomial(known.alpha, row.true_m), s = known.noise.spread(row.true_m, f);
    if (!(s > 0.0)) return std::nullopt;
    return (*density_)((row.reading_m - f) / s, s).outlier;
  }

  void correct_reading(double reading, std::optional<double> outlier_probability) {
    const std::string field = std::isnan(reading) ? "" : fmt::format("{}", reading);
    std::string outlier;
    if (state_.tells_outliers) outlier = ",";
    if (state_.tells_outliers && outlier_probability && std::isfinite(*outlier_probability))
      outlier += fmt::format("{:.3g}", *outlier_probability);
    if (!corrector_) return output_.print(field + ",,,no_calibration_yet" + outlier + "\n");
    const CorrectionCandidate best = correction_candidates(*corrector_, reading, {}, false).front();
    if (best.flag.starts_with("out_of_range"))
      ++state_.out_of_range;
    else if (best.distance_m)
      ++state_.corrected;
    output_.print(
        fmt::format("{},{},{},{}{}\n", field, best.distance_m ? fmt::format("{:.6f}", *best.distance_m) : "",
                    best.std_dev_m ? fmt::format("{:.6f}", *best.std_dev_m) : "", best.flag, outlier));
  }

  const TrackJob& job_;
  std::vector<std::unique_ptr<WriteLock>> locks_;
  std::unique_ptr<Learner> learner_;
  std::string name_, lost_;
  std::optional<Calibration> given_;
  std::optional<EffectCorrector> corrector_;
  std::optional<ShapeDensity> density_;  ///< of the calibration that corrects
  std::optional<ChangeDetector> detector_;
  std::unique_ptr<LineSource> source_;
  TrackOutput output_;
  Columns columns_;
  TrackState state_;
  bool watching_ = false, resumed_ = false, same_stops_ = true;
  std::vector<std::string> notes_;
};

}  // namespace

Tracked track(const TrackJob& job) { return Run(job).run(); }

}  // namespace rangecal::app
