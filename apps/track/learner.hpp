// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "track/columns.hpp"
#include "track/tracking.hpp"

namespace rangecal::app {

/// What a stream teaches: a calibrator of pairs or of landmark readings behind one face.
class Learner {
 public:
  virtual ~Learner() = default;

  /// Takes a row that can teach something, false for one that cannot (no true distance). Throws InputError
  /// for a row of landmarks that cannot be understood.
  virtual bool take(const StreamRow& row) = 0;
  virtual Calibration estimate() = 0;
  /// That the last row taken is an outlier, by what was taken before it; none where nothing is known of it, and of pairs.
  virtual std::optional<double> outlier_probability() const { return std::nullopt; }
  virtual const Counts& counts() const = 0;
  virtual std::int64_t used() const = 0;
  virtual std::int64_t stops_left_out() const { return 0; }  ///< without an optimum beside the others
  virtual double effective() const = 0;                      ///< readings that count
  virtual std::int64_t first_estimate() const = 0;           ///< readings before which there is none
  virtual std::int64_t least_between() const = 0;            ///< readings from one estimate to the next
  virtual std::string to_json() const = 0;
  /// --watch of readings of landmarks: each that is taken is held against `reference`.
  virtual void watch(const Calibration& reference, const ChangeOptions& options);
  virtual std::optional<ChangeAlarm> alarm() const { return std::nullopt; }  ///< of the last row taken
  virtual std::string watch_state() const { return "null"; }
  virtual void restore_watch(const std::string& state);
  /// Takes the state saved before. Throws InputError naming `path` where it was made with other options.
  virtual void restore(const nlohmann::ordered_json& state, const std::string& path) = 0;
  /// What of --stops was used so far, to tell by whether the recording is the same; null without one.
  virtual nlohmann::ordered_json stops_used() const { return nullptr; }
  /// Of a learner restored: false where the recording is otherwise in what was used.
  virtual bool same_stops(const nlohmann::ordered_json&) { return true; }
};

/// For the stream's columns. Throws InputError where the job asks for what these cannot have: no option is ignored.
std::unique_ptr<Learner> make_learner(const TrackJob& job, const Columns& columns);

}  // namespace rangecal::app
