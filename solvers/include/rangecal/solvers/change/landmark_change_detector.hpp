// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "rangecal/core/calibration.hpp"
#include "rangecal/solvers/change/change_detector.hpp"
#include "rangecal/solvers/recursive/recursive_landmarks.hpp"

namespace rangecal {

struct LandmarkWatch;

/// Watches a calibration for a change by readings of landmarks in unknown places. No distance is known: what the
/// calibration, with its covariance, the stops' priors and the readings so far foretell is held against each reading
/// (LandmarkFilter). If nothing has changed, the innovations over their standard deviations z are independent N(0, 1).
///
/// A change of kind k and size b after reading j (ChangeKind) shifts a later reading by b g. The estimates follow it:
/// with H and K the rows and gains of the filter, beta what the change has done to its state per unit of b,
///
///   gamma = g - H beta,   beta <- beta + K gamma,   z ~ N(b gamma / sqrt(S), 1)      (Willsky and Jones 1976, IEEE
///                                                                                     Trans. AC 21, 108)
///
/// so that with U = sum z gamma / sqrt(S), I = sum gamma^2 / S over the readings after j and b ~ N(0, tau^2) the
/// likelihood ratio of the change is L = exp(tau^2 U^2 / (2 (1 + tau^2 I))) / sqrt(1 + tau^2 I); tau is the size looked
/// for. For the spread, b = +- log(noise_factor), L is the mean of both. The alarm is raised where
///
///   R = sum over j of w_j mean over k of L_jk > N,   w_j the readings from one such j to the next  (Shiryaev-Roberts).
///
/// Under no change every L has mean 1, R less the readings so far is a supermartingale, and the average run length is
/// at least N readings whatever the stops and landmarks, in the linear model of the filter (Pollak 1985, Ann. Statist.
/// 13, 206). j are the beginnings of stops; the latest 32 stops are kept, of older ones every second, fourth, ..., up
/// to 512. A reading some 50 standard deviations off makes R larger than numbers are: it raises the alarm, and which j
/// is the most probable is told by the logarithms.
///
/// What changed is told as by ChangeDetector, `naming` readings after the alarm, from U and I of the j that is the most
/// probable by then; the alarm that is named may begin elsewhere than it did when it was raised. The noise of the
/// calibration is taken as exact, a change of bearings is not looked for.
class LandmarkChangeDetector {
 public:
  /// `random_walk`: the stops' covariances are those of their steps. Throws InputError for a calibration without a
  /// curve, spread or sigma_theta, with effects, and for bad options; `bearings` has no meaning here.
  explicit LandmarkChangeDetector(const Calibration& reference, bool random_walk = false,
                                  const ChangeOptions& options = {});
  ~LandmarkChangeDetector();
  LandmarkChangeDetector(LandmarkChangeDetector&&) noexcept;
  LandmarkChangeDetector& operator=(LandmarkChangeDetector&&) noexcept;

  /// Takes one reading; the alarm it raises or names, if any. The stop has accuracies or a covariance of its own. A
  /// reading that is not finite and positive, or 1e100 standard deviations off, is passed over. Throws InputError naming
  /// stop or landmark for a pose that is not finite and for an accuracy or a radius that is negative or not finite;
  /// nothing is changed then. Cost: 26 us with five
  /// landmarks, some 100 beginnings of stops being looked back at; linear in the landmarks up to some 50.
  std::optional<ChangeAlarm> add(const LandmarkReading& reading);
  /// A stop of a random walk from which nothing was read. Throws as add does.
  void pass(const Stop& stop);

  std::int64_t readings() const;
  /// The whole state, and back into a detector made alike; throws InputError for a text that is no such state: not
  /// whole or finite, with a P that is no covariance, or counts and sums that no readings make.
  std::string to_json() const;
  void restore(const std::string& json);

 private:
  std::unique_ptr<LandmarkWatch> watch_;
};

}  // namespace rangecal
