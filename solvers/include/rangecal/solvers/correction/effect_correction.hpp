// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <limits>
#include <optional>
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
  bool complete = true;              ///< false: a field is empty that an effect of the calibration needs
  bool extrapolated_column = false;  ///< a column that an effect uses is outside `Calibration::effects_range`
};

struct MeanReading;

/// Undoes the effects of a calibration: with delta r and v what the effects do to mean and log variance of a reading,
///   g(d) = f(d) + delta r(d, setting),   s(d) the noise law's spread times exp(v / 2),
/// the distances are the roots of g(d) = y and the minima of log s + (y - g)^2 / (2 s^2). An effect may fold g, so that
/// a reading has several roots where f has one, or none: all those between the turning points of g are found
/// (solvers/src/correction/stretches.hpp). Standard deviations are s / |g'| and sqrt(s^2 + var g(d)) / |g'|,
///   var g(d) = h^T C h,   h = (dg/dalpha_0, .., dg/dalpha_n, dg/dtheta_1, ..),
/// C the calibration's `effects_covariance` of alpha and the effects' parameters theta; dg/dalpha_i is u^i, u the scaled distance of the
/// curve, and what the effects that act before the curve make of it. dg/dtheta is the tangent, by a central difference; of a parameter
/// that sets a distance at which the effect jumps, the difference over one standard deviation to either side. Without that
/// covariance the effects count as exact (`takes_effects_as_exact`): var g = `curve_variance`.
///
/// The calibration must outlive this.
class EffectCorrector {
 public:
  /// Throws InputError for an effect or parameter that is in no catalogue. `covariates`: names of the columns at hand.
  EffectCorrector(const Calibration& calibration, std::vector<std::string> covariates);
  EffectCorrector(const Calibration&&, std::vector<std::string>) = delete;  ///< would be gone

  /// Columns that the effects' changes of the range depend on, each with the effect that asks for it: "bearing_rad",
  /// "heading_rad", "time_s", "radius_m", "landmark", "stop", "repeat", or a covariate's name. Throws InputError for an effect
  /// that counts time in durations of its recording where `Calibration::effects_range` has no time_s, whose end is the duration.
  struct Need {
    std::string column, effect;
  };
  std::vector<Need> needs() const;

  /// Every distance that explains the reading. Throws InputError as rangecal::correct. Cost: some thousand changes, 30
  /// us for one effect.
  Correction correct(double reading_m, const ReadingSetting& setting,
                     const CorrectionOptions& options = {}) const;

  /// What a reading of the distance d [m] is expected to be: its mean f(d) + delta r, its standard deviation
  /// sqrt(s^2 e^v + var g(d)), and that of its noise alone, s e^(v/2), all in metres.
  struct Expected {
    double mean_m = 0.0, spread_m = 0.0, noise_m = 0.0;
  };
  Expected at(double d, const ReadingSetting& setting) const;
  /// f'(d) = 0 inside (low, high), ascending.
  std::vector<double> turning_points(double low_m, double high_m) const;
  /// g'(d) = 0 or a jump of g inside (low, high), ascending; f'(d) = 0 where g is far from the reading.
  std::vector<double> turning_points(double low_m, double high_m, double reading_m,
                                     const ReadingSetting& setting) const;
  const Calibration& calibration() const { return calibration_; }
  /// Readings are changed by effects, and the calibration does not say how well their parameters are known.
  bool takes_effects_as_exact() const;

 private:
  struct Active {
    const Effect* effect;
    Eigen::VectorXd parameters;
  };
  /// A parameter of an effect that is not exact.
  struct Estimated {
    std::size_t active;
    Eigen::Index parameter, row;  ///< row of the covariance
    double step;                  ///< of its difference
  };
  ReadingView<double> view(double d, const ReadingSetting& setting) const;
  ReadingChange<double> change(double d, const ReadingSetting& setting) const;
  /// What effects in the order of their stages change together.
  static ReadingChange<double> changed_by(const std::vector<Active>& effects, const ReadingView<double>& at);
  /// The view with what effects of earlier stages add.
  ReadingView<double> seen_by(const Active& active, const ReadingView<double>& at) const;
  /// d g(d) / d alpha_i: u^i, u the scaled distance of the curve, and what the effects that come before the curve make of it.
  Eigen::VectorXd slopes_in_alpha(double d, const ReadingSetting& setting) const;
  /// var g(d) of the class [m^2]; none where the calibration has no covariance.
  std::optional<double> mean_variance(double d, const ReadingSetting& setting) const;
  MeanReading mean_reading(const ReadingSetting& setting) const;
  /// The noise law's spread [m] at the reading, or at the largest f in [low, high] where the reading is beyond that.
  double spread_near(double reading_m, double low_m, double high_m) const;
  /// `h`: step of the slope [m].
  CorrectionRoot root_at(double d, double reading_m, const ReadingSetting& setting, double h) const;

  const Calibration& calibration_;
  EffectContext context_;
  std::vector<Active> active_;  ///< in the order of their stages
  std::vector<Estimated> estimated_;
};

}  // namespace rangecal
