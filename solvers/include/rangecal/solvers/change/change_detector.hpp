// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"

namespace rangecal {

/// What can change in a sensor, as a direction g of the standardised error z = (y - f(d)) / s(d) per unit of its size b:
/// z ~ N(b g, 1) after the change.
enum class ChangeKind {
  window,    ///< an offset b [m], as a new window or zero: g = 1 / s
  baseline,  ///< the baseline or the focal length by the share b: y f-fold, g = f / s
  pointing,  ///< the laser's or the camera's angle, an offset of the disparity b [1/m]: g = f^2 / s
  encoder,  ///< once a turn, b_c cos + b_s sin of the bearing [m]: g = cos / s, sin / s; where readings have a bearing
  noise  ///< the spread, by the factor exp(b): variance e^(2b)
};
/// "window", "baseline", "pointing", "encoder", "noise".
const char* to_string(ChangeKind kind);

struct ChangeOptions {
  double run_length = 100000.0;  ///< readings between two alarms where nothing changes, all charts together
  double shift =
      0.5;  ///< size looked for, as the RMS of b g over the distances fitted: standard deviations of a
            ///< reading. Smaller sizes are found, too, only later
  double noise_factor = 1.5;  ///< of the spread, looked for upwards and downwards
  bool bearings = false;      ///< readings come with a bearing: the encoder is watched
  int naming = 300;           ///< readings after an alarm by which the change is named

  void check() const;
};

/// Raised twice: at once, and when it has a name.
struct ChangeAlarm {
  std::int64_t reading = 0;  ///< number of the reading at which it was raised; the first is 1
  std::int64_t since = 0;    ///< reading after which the change is placed: where the chart was last at 0
  bool named = false;        ///< what follows is known
  ChangeKind kind = ChangeKind::window;
  double probability = 0.0;          ///< of this kind among all, equal before
  double size = 0.0, std_dev = 0.0;  ///< b by maximum likelihood, in the unit of its kind
};

/// Watches a calibration for a change, reading by reading, by likelihood-ratio CUSUMs (Page 1954, Biometrika 41, 100;
/// Basseville and Nikiforov, Detection of Abrupt Changes, 1993, ch. 2.2): for each kind and sign
///
///   S <- max(0, S + l),   l = b g z - b^2 g^2 / 2   (noise: l = -log rho + z^2 (1 - rho^-2) / 2),   alarm at S > h.
///
/// The steps of a chart have mean -D and variance 2 D under no change, D the mean of b^2 g^2 / 2. Its average run length is
/// that of a Brownian motion with the excess over the limit added (Siegmund 1985, Sequential Analysis, ch. 2.6; 10.2),
///
///   ARL = (e^h' - h' - 1) / D,   h' = h + 1.166 sqrt(2 D),
///
/// from which h follows for charts that share the alarms equally; charts are correlated, so the true ARL of all together is
/// longer than stated. For the noise, whose steps are not normal, h comes from the renewal of a simulated chart (fixed
/// seed). D is the mean over the distances fitted, evenly taken.
///
/// The directions are alike over few readings. What changed is therefore told from the next `naming` readings: for each
/// kind the gain of likelihood at its best size, (sum g z)^2 / (2 sum g^2) (encoder: both waves; noise: N (v - 1 - log v) / 2,
/// v the mean of z^2), less half the logarithm of the readings for a second unknown; the probability of a kind is its
/// share of e^gain. A change that stays alarms again.
///
/// The calibration is taken as exact: let it come from many more readings than a change takes to be found.
class ChangeDetector {
 public:
  /// Throws InputError for a calibration without a curve or spread and bad options.
  ChangeDetector(const Calibration& reference, const ChangeOptions& options = {});

  /// Takes one reading of a known distance; the alarm it raises or names, if any. All charts start again then. Readings that are not finite and positive are passed over. Cost: some 50 ns.
  std::optional<ChangeAlarm> add(double true_m, double reading_m, double bearing_rad = 0.0);

  std::int64_t readings() const { return readings_; }
  /// The charts' present values and counters, to be handed to `restore` of a detector made alike.
  std::vector<double> state() const;
  void restore(const std::vector<double>& state);  ///< throws InputError for a state of another length

 private:
  struct Chart {
    ChangeKind kind;
    int wave = 0;                           ///< encoder: 0 cos, 1 sin
    double size, limit;                     ///< b, h
    double value = 0.0;                     ///< S
    double score = 0.0, information = 0.0;  ///< while naming: sum g z, sum g^2; noise: sum z^2, count
    std::int64_t since = 0;
  };
  void start_again();
  void name(ChangeAlarm& alarm) const;

  Calibration reference_;
  ChangeOptions options_;
  std::vector<Chart> charts_;
  std::int64_t readings_ = 0;
  std::int64_t naming_left_ = 0;  ///< readings until the open alarm is named; 0: none is open
  ChangeAlarm open_;
};

/// h for an average run length of `run_length` readings of one chart whose steps have D = mean(b^2 g^2) / 2.
double cusum_limit(double run_length, double D);

}  // namespace rangecal
