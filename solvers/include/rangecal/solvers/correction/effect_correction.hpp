// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <string>
#include <vector>

#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/solvers/correction/correct.hpp"

namespace rangecal {

/// What is known about one reading besides its range; NaN or -1 where it is not known.
struct ReadingSetting {
  double bearing_rad = std::numeric_limits<double>::quiet_NaN();  ///< direction in the sensor frame
  double heading_rad = std::numeric_limits<double>::quiet_NaN();  ///< of the stop
  double time_s = std::numeric_limits<double>::quiet_NaN();       ///< since the first reading
  double radius_m = std::numeric_limits<double>::quiet_NaN();     ///< of the landmark
  int landmark = -1, stop = -1, repeat = 0;  ///< landmark, stop: indices into the calibration's lists
  std::vector<double> covariates;            ///< by the names given to EffectCorrector
  bool complete = true;  ///< false: a field is empty that an effect of the calibration needs
};

/// Undoes the effects of a calibration: with delta r and v what the effects do to mean and log variance of a reading,
///   f(d) = y - delta r(d, setting)      solved by iteration from d of f(d) = y,
/// for every root. Standard deviations are those of `correct`, the reading's own noise scaled by exp(v / 2).
class EffectCorrector {
 public:
  /// Throws InputError for an effect or parameter that is in no catalogue. `covariates`: names of the columns at hand.
  EffectCorrector(const Calibration& calibration, std::vector<std::string> covariates);

  /// Columns that the effects' changes of the range depend on, each with the effect that asks for it: "bearing_rad",
  /// "heading_rad", "time_s", "radius_m", "landmark", "stop", "repeat", or a covariate's name.
  struct Need {
    std::string column, effect;
  };
  std::vector<Need> needs() const;

  /// Every distance that explains the reading. Cost: some ten corrections.
  Correction correct(double reading_m, const ReadingSetting& setting,
                     const CorrectionOptions& options = {}) const;

  /// What a reading of the distance d [m] is expected to be: its mean f(d) + delta r, and its standard deviation
  /// sqrt(s^2 e^v + phi^T cov(alpha) phi), both in metres.
  struct Expected {
    double mean_m = 0.0, spread_m = 0.0;
  };
  Expected at(double d, const ReadingSetting& setting) const;
  /// f'(d) = 0 inside (low, high), ascending.
  std::vector<double> turning_points(double low_m, double high_m) const;
  const Calibration& calibration() const { return calibration_; }

 private:
  struct Active {
    const Effect* effect;
    Eigen::VectorXd parameters;
  };
  ReadingView<double> view(double d, const ReadingSetting& setting) const;
  ReadingChange<double> change(double d, const ReadingSetting& setting) const;

  const Calibration& calibration_;
  EffectContext context_;
  std::vector<Active> active_;
};

}  // namespace rangecal
