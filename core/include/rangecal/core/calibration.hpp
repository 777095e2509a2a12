// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <map>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/curve_scale.hpp"
#include "rangecal/core/noise.hpp"
#include "rangecal/core/outcome.hpp"
#include "rangecal/core/recording.hpp"

namespace rangecal {

/// The methods that stand side by side.
enum class Method { closed_form, approximate, full, marginal };
/// All of them, the one to trust before the others last.
std::span<const Method> all_methods();
/// "closed-form", "approximate", "full", "marginal".
const char* to_string(Method method);
Method method_from_string(const std::string& text);

/// A number with its standard deviation (absent where there is none; `why` says so).
struct Estimate {
  double value = 0.0;
  std::optional<double> std_dev;
};

/// The density of a channel's standardised errors where it is not the Gaussian; sigmas are then its scales.
struct ShapeEstimate {
  std::string family;  ///< "student-t", "contaminated" or "one-sided"
  /// nu; outlier_share and outlier_scale; outlier_share and outlier_mean [m], > 0 of late returns, < 0 of early echoes
  std::map<std::string, double> parameters;
  std::map<std::string, double> std_dev;  ///< of those that are known and at no end of their range
};

struct LandmarkEstimate {
  int recording = 0;  ///< which recording of the job
  std::string label;
  Eigen::Vector2d position_m = Eigen::Vector2d::Zero();
  std::optional<Eigen::Matrix2d> covariance;  ///< [m^2]
  std::optional<Eigen::Matrix2d> covariance_by_stops =
      std::nullopt;  ///< see Calibration::alpha_covariance_by_stops [m^2]
};

/// Is the curve better than none? Readings of groups that were left out whole, raw and corrected by the curve of the others,
/// against distances that no range told: where bearings and commanded stops alone put stops and landmarks (pairs: the known
/// ones). The reference's own error is in both.
struct LeftOutCheck {
  int groups = 0;                               ///< left out in turn
  std::string what = "stops";                   ///< the groups are: "stretches of the walk", "batches"
  double rms_raw_m = 0.0, rms_raw_std_m = 0.0;  ///< of raw readings, and its standard error [m]
  double rms_corrected_m = 0.0, rms_corrected_std_m = 0.0;  ///< of corrected ones [m]
  /// Of the difference between the curves of both halves of the recording, if the model held; none where a half alone
  /// does not determine one.
  std::optional<double> halves_p_value;
  bool usable = true;
  std::string reason;  ///< why it is not usable
};

/// How much larger standard deviations by stops, or by landmarks, are than the model's.
struct MisfitOfDeviations {
  double factor = 1.0;  ///< of the curve or of the landmarks, whichever is furthest above its threshold
  /// Above this the model does not hold: 1.5, or what chance does with so few groups (solvers/src/calibrate/left_out_check.cpp).
  double threshold = 1.5;
  std::string clusters = "stops";  ///< left out in turn: "stops" or "landmarks"
  std::string where;               ///< "the curve at 3.1 m", "landmark T4"

  bool holds() const { return factor <= threshold; }
};

struct StopEstimate {
  int recording = 0;
  std::string label;
  Pose2 pose;
};

/// A reading that the noise shape takes for an outlier.
struct OutlierReading {
  int recording = 0;    ///< which recording of the job
  int row = 0;          ///< its line in the file (header = 1); of readings made in memory its number, from 1
  std::string channel;  ///< "range" or "bearing", the one that is further off
  double sigmas = 0.0;  ///< its error in the spreads of a reading that is no outlier, signed
  std::string
      reason;  ///< what it most likely is: "label of B", "late echo", "early echo", "grazing", "bearing"
};

/// How well the parameters of effects are known together with the curve.
struct EffectsCovariance {
  std::vector<std::string>
      parameters;  ///< "EFFECT.PARAMETER"; those of `Calibration::effects` that are not here are exact
  Eigen::MatrixXd matrix;  ///< of alpha_0 .. alpha_n, then the parameters
};

/// What a calibration method delivers: f, the noise law, and where it has them landmarks and stops, with their
/// uncertainties, or the reason why there are none.
struct Calibration {
  Method method = Method::marginal;
  RecordingKind kind = RecordingKind::landmarks;
  Outcome outcome = Outcome::failed;
  std::string reason;  ///< in words; empty when converged and nothing needs saying

  CurveScale scale;       ///< u(d), what f is a polynomial in
  Eigen::VectorXd alpha;  ///< order + 1 coefficients of f(d) = sum alpha_i u^i; alpha_i in m^(1-i)
                          ///< on a scale of metres, of a reciprocal in m^(1+i)
  std::optional<Eigen::MatrixXd>
      alpha_covariance;  ///< given order, scale, noise law and the effects' parameters
  /// The same from how the answer changes when each stop (along a random walk: each stretch of it) is left out (jackknife,
  /// clustered by stop): holds where the noise law is wrong or readings of a stop depend on each other. None with fewer than 4.
  std::optional<Eigen::MatrixXd> alpha_covariance_by_stops;
  /// The same from landmarks left out in turn, where there are more landmarks than stops: holds where readings of a landmark have
  /// an error in common. None with fewer than 4.
  std::optional<Eigen::MatrixXd> alpha_covariance_by_landmarks;
  std::optional<MisfitOfDeviations> misfit;  ///< of these to the model's
  std::optional<LeftOutCheck> left_out;      ///< none where it was not asked or cannot be judged
  /// Where order, noise law or the scale's offset were chosen by the data: with that choice in it, padded with zeros to the
  /// highest order that may hold; alpha is padded likewise. An offset c moves f by f'(u) u^2, a polynomial in u of one order
  /// more. None: nothing was chosen, or one model alone can be right.
  std::optional<Eigen::MatrixXd> covariance_with_choice;
  /// The Cramer-Rao bound of alpha at the estimate: standard deviations, where it was asked for.
  std::optional<Eigen::VectorXd> bound_alpha_std;
  std::string covariance_reason;  ///< why there is no covariance, or a caution about it
  Noise noise;
  std::vector<Estimate> noise_estimates;              ///< one per noise parameter
  std::map<std::string, ShapeEstimate> noise_shapes;  ///< of "range" and "bearing"; none: Gaussian
  int outlier_count = 0;                 ///< readings that the noise shapes take for outliers rather than not
  std::vector<OutlierReading> outliers;  ///< the gravest of them, up to ten, the furthest off first
  std::optional<Estimate> sigma_theta_rad;
  std::optional<Estimate> sigma_s_m;        ///< only where it was estimated
  std::optional<double> sigma_s_upper95_m;  ///< one-sided 95 % limit from the profile where the estimate is 0
  double range_min_m = 0.0, range_max_m = 0.0;  ///< distances over which it was fitted

  std::map<std::string, std::map<std::string, double>> effects;  ///< id -> parameter -> value, for `correct`
  std::optional<EffectsCovariance> effects_covariance;  ///< where effects were estimated with the curve
  /// [from, to] of the values over which the effects were fitted, of each column that they use. Of an angle that is the
  /// shortest arc which holds them (angles.hpp): from > to where it holds 180 degrees. Empty where it is not known.
  std::map<std::string, std::pair<double, double>> effects_range;
  std::vector<std::string>
      labels;  ///< of pairs: their landmarks, as the effects count them; none were placed
  std::vector<LandmarkEstimate> landmarks;
  std::vector<StopEstimate> stops;
  Counts counts;

  std::optional<double> joint_nll;  ///< at this method's best stops [nats], constants included
  std::optional<double>
      marginal_nll;           ///< stops integrated out by Laplace's method [nats]; for pairs the plain NLL
  std::optional<double> aic;  ///< 2 (marginal NLL + alpha, noise and landmark parameters)
  std::string weakest_direction;  ///< in the user's parameters
  int iterations = 0;
  double seconds = 0.0;  ///< wall time of the solve, filled in by the caller that timed it

  int order() const { return static_cast<int>(alpha.size()) - 1; }
  double f(double d) const;      ///< the mean reading at distance d [m]
  double slope(double d) const;  ///< f'(d)
};

/// Labels of the landmarks in the order in which effects count them.
std::vector<std::string> labels_of_landmarks(const Calibration& calibration);

/// C, what the calibration says of the uncertainty of f's coefficients: the covariance with the choice of the model in it
/// where there is one, else that of alpha given the model. Entry (i, j) in m^(2-i-j); none where the calibration has neither.
const std::optional<Eigen::MatrixXd>& curve_covariance(const Calibration& calibration);
const std::optional<Eigen::MatrixXd>& curve_covariance(const Calibration&&) = delete;  ///< would be gone

/// What the uncertainty of a spline's shape adds to the variance of f(d) [m^2], (df/du)^2 var(u); 0 of other scales, whose
/// uncertainty is in C.
double shape_variance(const Calibration& calibration, double distance_m);

/// Variance of the curve f(d) [m^2]: p^T C p, p = (1, u, u^2, ...), u = u(d), C of `curve_covariance`, and that of a spline's shape;
/// none where there is no covariance.
std::optional<double> curve_variance(const Calibration& calibration, double distance_m);

/// Throws InputError where f is no polynomial in the distance, which `user` ("--from") cannot do without.
void require_polynomial(const Calibration& calibration, const std::string& user);

}  // namespace rangecal
