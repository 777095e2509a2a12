// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// What can change in a sensor, as a direction g of the standardised error z = (y - f(d)) / s(d) per unit of its size b:
/// z - b g is distributed after the change as z was before, by the density p of the calibration's noise shape.
enum class ChangeKind {
  /// An offset b [m], as a new window or zero: g = 1 / s.
  window,
  /// The baseline or the focal length by the share b: y f-fold, g = f / s.
  baseline,
  /// The laser's or the camera's angle, an offset of the disparity b [1/m]: g = f^2 / s.
  pointing,
  /// Once a turn, b_c cos + b_s sin of the bearing [m]: g = cos / s, sin / s; where readings have a bearing.
  encoder,
  /// The spread, by the factor exp(b): variance e^(2b).
  noise,
  /// The share of outliers, to b: of those of the reference's shape, or N(0, 20^2) where that has none.
  outliers
};
/// "window", "baseline", "pointing", "encoder", "noise", "outliers".
const char* to_string(ChangeKind kind);

struct ChangeOptions {
  /// N: readings between two alarms where nothing changes, at least, all charts together.
  double run_length = 100000.0;
  /// Size looked for, as the RMS of b g over the distances fitted: standard deviations of a reading. Smaller sizes are
  /// found, too, only later.
  double shift = 0.5;
  double noise_factor = 1.5;  ///< of the spread, looked for upwards and downwards
  /// Share of outliers looked for, or four times the reference's where that is more (and a quarter of that).
  double outlier_share = 0.02;
  bool bearings = false;  ///< readings come with a bearing: the encoder is watched
  int naming = 300;       ///< readings after an alarm by which the change is named

  void check() const;
};

/// Raised twice: at once, and when it has a name.
struct ChangeAlarm {
  std::int64_t reading = 0;  ///< number of the reading at which it was raised; the first is 1
  std::int64_t since = 0;    ///< reading after which the change is placed: where the chart was last at 0
  bool named = false;        ///< what follows is known
  ChangeKind kind = ChangeKind::window;
  double probability = 0.0;  ///< of this kind among all, equal before
  /// b by maximum likelihood, in the unit of its kind; encoder: the amplitude.
  double size = 0.0, std_dev = 0.0;
  /// Encoder: size cos(bearing - phase) [rad]. None of other kinds.
  std::optional<Estimate> phase_rad = {};
};

/// Watches a calibration for a change, reading by reading. For each kind k and sign a chart holds the likelihood ratio of
/// that change since the reading after j, summed over all j (Shiryaev-Roberts; Pollak 1985, Ann. Statist. 13, 206):
///
///   R_k <- (1 + R_k) e^l,   l = log p_k(z) - log p(z),   alarm at R = mean over k of R_k > N,
///   p_k(z) = p(z - b g)   (noise: p(z / rho) / rho; outliers: the mixture with the other share).
///
/// Gaussian: l = b g z - b^2 g^2 / 2. While nothing changes e^l has mean 1 whatever g is. R less the readings so far is then a martingale, so
/// that the mean of R at the alarm is the average run length: it is at least N, and exceeds it by the excess of R over N
/// alone, whatever the distances, however alike they or the charts are. b is chosen for an even design (`shift`). The
/// beginning of the change is where Page's sum of the chart that counts most, S <- max(0, S + l), was last at 0
/// (Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 2.2). A reading some 50 standard deviations off
/// makes R larger than numbers are: that is an alarm, after which all R begin at 0 as always, and log R, which is
/// log(1 + R before) + l, tells which chart counts most.
///
/// The directions are alike over few readings. What changed is therefore told from the next `naming` readings, which the
/// alarm did not choose: the size b of a kind (encoder: of both waves, which are not orthogonal over a few readings)
/// maximises sum log p_k, whose gain over b = 0 counts, less half the logarithm of the readings for a second unknown; the
/// probability of a kind is its share of e^gain. Gaussian: b = I^-1 U with U = sum g z and I = sum g g^T, the gain
/// U^T I^-1 U / 2. With C the covariance of the calibration's alpha, x = (1, d, d^2, ...), A = i sum g x^T / s,
/// I = i sum g g^T and i what a reading of the shape tells of its place (ShapeInformation::location),
///
///   cov b = I^-1 + I^-1 A C A^T I^-1   (noise: 1 / (2 N) of Gaussian noise, and the variance of log sigma_e).
///
/// A change that stays alarms again.
///
/// To raise an alarm the calibration is taken as exact: let it come from many more readings than a change takes to be
/// found.
class ChangeDetector {
 public:
  /// Throws InputError for a calibration without a curve or spread and bad options.
  ChangeDetector(const Calibration& reference, const ChangeOptions& options = {});

  /// Takes one reading of a known distance; the alarm it raises or names, if any. All charts start again then. Readings
  /// that are not finite and positive, or 1e100 standard deviations off, are passed over and not counted. Cost: some
  /// 0.2 us.
  std::optional<ChangeAlarm> add(double true_m, double reading_m, double bearing_rad = 0.0);

  std::int64_t readings() const { return readings_; }
  /// The charts' present values and counters, to be handed to `restore` of a detector made alike.
  std::vector<double> state() const;
  /// Throws InputError for a state of another length, with a number that is not finite, or with counts and sums that no
  /// readings make. Of earlier versions it takes what they have: charts of outliers begin anew, of version 0.1.0 Page's
  /// sums count; an alarm that was open then is named by the next `naming` readings.
  void restore(const std::vector<double>& state);

  /// A reading of a known distance, as `add` takes it.
  struct Reading {
    double true_m, reading_m, bearing_rad;
  };

 private:
  struct Chart {
    ChangeKind kind;
    int wave = 0;            ///< encoder: 0 cos, 1 sin
    double size;             ///< b
    double ratio = 0.0;      ///< R, infinite only at an alarm
    double before = 0.0;     ///< R before the latest reading
    double step = 0.0;       ///< l of the latest reading
    double value = 0.0;      ///< S
    std::int64_t since = 0;  ///< reading at which S was last 0
  };
  void add_charts(ChangeKind kind, int wave);
  double step_of(const Chart& chart, double f, double s, double z, double bearing, double log_before) const;
  bool restore_earlier_version(const std::vector<double>& state);
  const Chart* loudest() const;  ///< of an alarm; null: there is none
  void start_again();
  void name(ChangeAlarm& alarm) const;

  Calibration reference_;
  ChangeOptions options_;
  NoiseShapeParameters shape_;  ///< of the reference
  ShapeDensity density_;
  std::vector<Chart> charts_;
  std::int64_t readings_ = 0;
  std::int64_t naming_left_ = 0;  ///< readings until the open alarm is named; 0: none is open
  ChangeAlarm open_;
  std::vector<Reading> since_;  ///< readings that came since the alarm was raised
};

}  // namespace rangecal
