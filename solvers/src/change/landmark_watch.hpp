// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "kalman/landmark_filter.hpp"
#include "rangecal/solvers/change/change_detector.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace rangecal {

/// What LandmarkChangeDetector holds; the equations are there.
struct LandmarkWatch {
  static constexpr std::size_t directions = 5;  ///< window, baseline, pointing; encoder: cos, sin

  /// A reading after which a change is thought of.
  struct Onset {
    std::int64_t since = 0, until = 0;  ///< j; stop number up to which it is kept
    double weight = 0.0;                ///< w
    std::array<Eigen::VectorXd, directions> beta;
    std::array<double, directions> score{}, information{};  ///< U, I
    double cross = 0.0;                                     ///< of I between cos and sin
    double log_up = 0.0, log_down = 0.0;                    ///< log L of the spread times and by its factor
    double spread_score = 0.0, spread_information = 0.0;    ///< sum share (z^2 - 1), sum share^2

    /// e^exponent / divisor: L of a direction, half that of the spread in either sense.
    struct Term {
      double exponent, divisor;
    };
    std::array<Term, directions + 2> terms(const std::array<double, directions>& tau) const;
    double ratio(const std::array<double, directions>& tau) const;      ///< mean over k of L; may be infinite
    double log_ratio(const std::array<double, directions>& tau) const;  ///< its logarithm, which is not
  };

  LandmarkWatch(const Calibration& reference, bool random_walk, const ChangeOptions& options);
  void start(const Stop& stop);
  std::optional<ChangeAlarm> add(const LandmarkReading& reading);
  /// By log w + log of the mean of L; of several alike the latest. There is at least one.
  const Onset& most_probable() const;
  void follow(Onset& onset, const LandmarkFilter::Taken& taken, double bearing) const;
  void name(ChangeAlarm& alarm, const Onset& onset);

  LandmarkFilter filter;
  ChangeOptions options;
  bool random_walk;
  std::array<double, directions> tau{};
  std::vector<Onset> onsets;
  std::string label, place;  ///< of the stop
  std::int64_t readings = 0, tested = 0, opened_at = 0, stops = 0, naming_left = 0;
  ChangeAlarm open;
};

std::string state_of(const LandmarkWatch& watch);
/// Throws InputError for a text that is no state of such a watch.
void restore_watch(const std::string& text, LandmarkWatch& watch);

}  // namespace rangecal
