// SPDX-License-Identifier: BSD-3-Clause
#include "track/tracking.hpp"

#include <fmt/core.h>
#include <signal.h>

#include <chrono>
#include <cmath>
#include <cstdio>
#include <filesystem>
#include <memory>
#include <nlohmann/json.hpp>
#include <thread>

#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/json_numbers.hpp"
#include "rangecal/core/write_lock.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "track/learner.hpp"
#include "track/line_source.hpp"
#include "track/saved_calibration.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;
constexpr const char* format_name = "rangecal-track/1";
constexpr int most_complaints = 10;
constexpr std::size_t most_changes = 1000;  // kept, the latest

volatile sig_atomic_t stopped = 0;
void stop(int) { stopped = 1; }

/// The state as JSON. What is nested deeper than any state would overrun the stack when it is handed on.
Json shallow_json(const std::string& text) {
  constexpr int deepest = 16;
  return Json::parse(text, [](int depth, Json::parse_event_t, Json&) {
    if (depth > deepest) throw InputError("is no state of 'rangecal track': it is nested too deeply");
    return true;
  });
}

class Run {
 public:
  explicit Run(const TrackJob& job) : job_(job), name_(job.input == "-" ? "stdin" : job.input) {
    if (!job.from.empty()) {
      given_ = load_calibration(job.from);
      require_curve(*given_, job.from);
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
    if (!job.state.empty() && file_exists(job.state)) load();
    source_ = std::make_unique<LineSource>(job.input, offset_);
    if (learner_)
      open_output();  // of a new stream only when its columns are known: a wrong file leaves what was there
    write_changes();  // a table without alarms is one, and none of an earlier run is left
  }

  Tracked run() {
    struct sigaction action {};
    action.sa_handler = stop;
    ::sigaction(SIGINT, &action, nullptr);
    ::sigaction(SIGTERM, &action, nullptr);
    if (current_)
      corrector_.emplace(*current_, std::vector<std::string>{});
    else if (given_)
      corrector_.emplace(*given_, std::vector<std::string>{});
    std::string line;
    bool idle = false;
    while (!stopped) {
      const LineSource::Status status = source_->next(line);
      if (status == LineSource::Status::interrupted) break;
      if (status == LineSource::Status::end) {
        if (!job_.follow || job_.input == "-") break;
        if (!idle) save();
        idle = true;
        std::this_thread::sleep_for(std::chrono::milliseconds(50));
        continue;
      }
      idle = false;
      take(line);
    }
    if (!stopped && source_->has_rest()) {
      if (job_.follow || (!job_.state.empty() && job_.input != "-"))
        notes_.push_back(name_ + ": the last line has no end yet and was left for the next run");
      else
        take(source_->rest());
    }
    if (columns_read_ == 0 && header_.empty()) throw InputError(name_, 0, "", "holds no reading");
    save();
    Tracked result;
    if (learner_->counts().read > 0) result.calibration = learner_->estimate();
    result.counts = learner_->counts();
    result.landmarks = columns_.landmarks();
    result.rows = rows_;
    result.corrected = corrected_;
    result.malformed = malformed_;
    result.effective = learner_->effective();
    result.timed = columns_.time >= 0;
    result.changes = changes_;
    result.notes = notes_;
    if (malformed_ > most_complaints)
      result.notes.push_back(fmt::format("{}: {} rows were not understood in all", name_, malformed_));
    return result;
  }

 private:
  void load() {
    const std::string& path = job_.state;
    try {
      const Json state = shallow_json(read_file(path, std::size_t{64} << 20));
      if (state.at("format") != format_name)
        throw InputError(path + ": field 'format' is not '" + format_name + "'");
      header_ = state.at("header").get<std::string>();
      if (!header_.empty()) columns_ = columns_of(header_, name_, line_);
      columns_read_ = header_.empty() ? 0 : 1;
      if (!header_.empty() || state.at("calibrator").is_object()) {
        begin();
        learner_->restore(state.at("calibrator"), path);
      }
      const auto count = [&](const char* key) { return whole_number<std::int64_t>(state.at(key), key); };
      offset_ = job_.input == "-" ? 0 : count("offset");
      line_ = job_.input == "-" ? 0 : static_cast<long>(count("line"));
      output_bytes_ = count("output_bytes");
      rows_ = count("rows");
      corrected_ = count("corrected");
      malformed_ = count("malformed");
      next_estimate_ = count("next_estimate");
      if (state.at("watch").is_null() == watching_)
        throw InputError(path + ": was made with or without --watch, now it is otherwise");
      if (detector_)
        detector_->restore(state.at("watch").get<std::vector<double>>());
      else if (watching_)
        learner_->restore_watch(state.at("watch").dump());
      for (const Json& c : state.at("changes")) {
        ChangeAlarm alarm{whole_number<std::int64_t>(c.at(0), "changes"),
                          whole_number<std::int64_t>(c.at(1), "changes"),
                          c.at(2),
                          {},
                          c.at(4),
                          c.at(5),
                          c.at(6)};
        alarm.kind =
            static_cast<ChangeKind>(whole_number(c.at(3), "changes", 0, static_cast<int>(ChangeKind::noise)));
        changes_.push_back(alarm);
      }
      if (state.at("calibration").is_object()) current_ = calibration_in(state.at("calibration"));
    } catch (const Json::exception& error) {
      throw InputError(path, 0, "", "is no state of 'rangecal track': " + json_complaint(error));
    } catch (const InputError& error) {
      const std::string what = error.what();
      throw what.starts_with(path) ? error : InputError(path, 0, "", what);
    }
  }

  void save() {
    if (std::fflush(out_) != 0)
      throw InputError(job_.output.empty() ? "stdout" : job_.output, 0, "", "cannot be written");
    if (job_.state.empty()) return;
    Json state{{"format", format_name},
               {"header", header_},
               {"offset", source_->offset()},
               {"line", line_},
               {"output_bytes", output_bytes_},
               {"rows", rows_},
               {"corrected", corrected_},
               {"malformed", malformed_},
               {"next_estimate", next_estimate_},
               {"calibration", current_ ? json_of(*current_) : Json(nullptr)},
               {"watch", detector_  ? Json(detector_->state())
                         : learner_ ? Json::parse(learner_->watch_state())
                                    : Json(nullptr)},
               {"changes", Json::array()},
               {"calibrator", learner_ ? Json::parse(learner_->to_json()) : Json(nullptr)}};
    for (const ChangeAlarm& c : changes_)
      state["changes"].push_back(
          {c.reading, c.since, c.named, static_cast<int>(c.kind), c.probability, c.size, c.std_dev});
    write_file(job_.state, state.dump() + "\n");
  }

  void open_output() {
    out_ = stdout;
    if (!job_.output.empty()) {
      std::error_code error;
      const bool resumed = output_bytes_ > 0;
      if (resumed) {
        const auto size = std::filesystem::file_size(job_.output, error);
        if (error || static_cast<std::int64_t>(size) < output_bytes_)
          throw InputError(job_.output, 0, "", "is missing or shorter than the state says");
        std::filesystem::resize_file(job_.output, static_cast<std::uintmax_t>(output_bytes_));
      }
      out_ = std::fopen(job_.output.c_str(), resumed ? "ab" : "wb");
      if (!out_) throw InputError(job_.output, 0, "", "cannot be written");
      closer_.reset(out_);
      if (resumed) return;
    }
    print("reading_m,distance_m,std_m,flag\n");
  }

  void print(const std::string& text) {
    if (std::fwrite(text.data(), 1, text.size(), out_) != text.size())
      throw InputError(job_.output.empty() ? "stdout" : job_.output, 0, "", "cannot be written");
    output_bytes_ += static_cast<std::int64_t>(text.size());
  }

  void complain(const std::string& column, const std::string& what) {
    if (++malformed_ <= most_complaints) notes_.push_back(InputError(name_, line_, column, what).what());
    print(",,,malformed\n");
  }

  void take(const std::string& line) {
    ++line_;
    if (line.find_first_not_of(" \t") == std::string::npos) return;
    if (columns_read_ == 0) {
      columns_read_ = 1;
      if (!number_of(line)) {
        header_ = line;
        columns_ = columns_of(line, name_, line_);
        begin();
        open_output();
        return;
      }
      if (!learner_) {
        begin();
        open_output();
      }
    } else if (job_.input == "-" && line == header_) {  // the same program started again
      return;
    }
    ++rows_;
    take_row(line);
    if (rows_ % job_.every == 0) save();
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
    try {
      const bool taken = learner_->take(row);
      if (const auto alarm = learner_->alarm(); taken && alarm) note(*alarm);
      if (taken && learner_->used() >= next_estimate_) estimate();
    } catch (const InputError& error) {
      if (!columns_.landmarks()) throw;
      return complain("", error.what());
    }
    correct_reading(row.reading_m);
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
    write_changes();
  }

  /// The calibration so far, and when to look again: after 2 % more pairs of those that count.
  void estimate() {
    if (learner_->used() >= learner_->first_estimate()) {
      Calibration now = learner_->estimate();
      if (now.outcome == Outcome::converged && now.alpha_covariance && now.range_max_m > now.range_min_m) {
        current_ = std::move(now);
        corrector_.emplace(*current_, std::vector<std::string>{});
      }
    }
    next_estimate_ = learner_->used() + std::max(learner_->least_between(),
                                                 static_cast<std::int64_t>(0.02 * learner_->effective()));
  }

  void watch(const StreamRow& row) {
    const auto alarm =
        detector_->add(row.true_m, row.reading_m, columns_.bearing >= 0 ? row.bearing_rad : 0.0);
    if (alarm) note(*alarm);
  }

  void note(const ChangeAlarm& alarm) {
    if (alarm.named && !changes_.empty())
      changes_.back() = alarm;
    else
      changes_.push_back(alarm);
    if (changes_.size() > most_changes) changes_.erase(changes_.begin());
    write_changes();
  }

  void write_changes() const {
    if (job_.changes.empty()) return;
    std::string text = columns_.landmarks() ? "reading,since_reading,kind,probability,size,std\n"
                                            : "pair,since_pair,kind,probability,size,std\n";
    for (const ChangeAlarm& c : changes_)
      text += c.named ? fmt::format("{},{},{},{:.4f},{:.6g},{:.2g}\n", c.reading, c.since, to_string(c.kind),
                                    c.probability, c.size, c.std_dev)
                      : fmt::format("{},{},,,,\n", c.reading, c.since);
    write_file(job_.changes, text);
  }

  void correct_reading(double reading) {
    const std::string field = std::isnan(reading) ? "" : fmt::format("{}", reading);
    if (!corrector_) return print(field + ",,,no_calibration_yet\n");
    const CorrectionCandidate best = correction_candidates(*corrector_, reading, {}, false).front();
    if (best.distance_m) ++corrected_;
    print(fmt::format("{},{},{},{}\n", field, best.distance_m ? fmt::format("{:.6f}", *best.distance_m) : "",
                      best.std_dev_m ? fmt::format("{:.6f}", *best.std_dev_m) : "", best.flag));
  }

  struct Close {
    void operator()(std::FILE* file) const { std::fclose(file); }
  };
  const TrackJob& job_;
  std::vector<std::unique_ptr<WriteLock>> locks_;
  std::unique_ptr<Learner> learner_;
  std::string name_, header_;
  std::optional<Calibration> given_, current_;
  std::optional<EffectCorrector> corrector_;
  std::optional<ChangeDetector> detector_;
  std::vector<ChangeAlarm> changes_;
  std::unique_ptr<LineSource> source_;
  std::unique_ptr<std::FILE, Close> closer_;
  std::FILE* out_ = stdout;
  Columns columns_;
  bool watching_ = false;
  int columns_read_ = 0;
  long line_ = 0;
  std::int64_t offset_ = 0, output_bytes_ = 0, rows_ = 0, corrected_ = 0, malformed_ = 0, next_estimate_ = 0;
  std::vector<std::string> notes_;
};

}  // namespace

Tracked track(const TrackJob& job) { return Run(job).run(); }

}  // namespace rangecal::app
