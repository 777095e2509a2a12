// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cmath>
#include <cstddef>
#include <memory>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/problems/tail_law.hpp"

namespace rangecal {

/// What an effect changes first; it decides how it is tested and how held-out blocks are cut.
enum class EffectKind {
  mean,        ///< the mean of range or bearing, or the mean pose of the stops
  noise,       ///< the variance of a reading
  dependence,  ///< independence between readings, or between stops
  tail,        ///< normality: outliers, skew
  label,       ///< which landmark a reading belongs to
  grid,        ///< values that sit on a grid
  detection    ///< which readings are there at all
};

/// One parameter of an effect. Its full name is `effect.name`, the name ending in the unit.
struct EffectParameter {
  std::string name;  ///< "amplitude_m"
  double typical =
      0.0;  ///< typical size, of either sign; also the scale of its prior, Student's t with two degrees of freedom
  double low = 0.0, high = 0.0;  ///< bounds set by physics
  bool linear =
      true;  ///< the change vanishes with it and is linear in it to first order: starts at 0, no grid
  bool discrete = false;  ///< chosen from the start grid, never moved (a landmark, a stop, a change point)
};

/// Half the width h of a central difference in a parameter at `value`: a millionth of its size, which is the value
/// itself of one that is positive by its nature (low > 0: a period, a time constant), else its typical size.
///
/// A difference over +-h is off by (h u)^2 / 6 of the derivative where a unit of the parameter turns a phase by u, and by
/// 1e-16 |f| / h where f does not vanish with it. A wavenumber k turns the reading at distance d by k / d [rad] in all,
/// thousands at decimetres: a thousandth of k would be some radians, a millionth is 0.005 rad at 0.15 m, 4e-6 of the
/// derivative. Rounding is some 1e-10 of it for parameters up to their typical size, 1e-8 for a hundred times that.
double difference_step(const EffectParameter& parameter, double value);

/// What a sensor measures with.
enum class Carrier { not_known, light, sound, radio };
/// By the words of a recording's `principle`: camera, triangulation, lidar, laser, ...; sonar, ultrasound, ...; radio, uwb, radar.
Carrier carrier_of(const std::string& principle);
/// What the sensor's principle says; where that says nothing, what its name says; where neither does, radio if a column is a
/// received power in dBm.
Carrier carrier_of(const Recording& recording);

/// What settles, of readings at known distances, whether an effect is there.
struct SettledOfPairs {
  std::vector<std::string> changes =
      {};                      ///< codes of the menu of next experiments: the first that it offers counts
  std::string otherwise = {};  ///< what to say where it offers none of them; empty: what is said of landmarks
};

/// Where between the surface and the number an effect acts. One that wobbles with distance does so with the distance that the effects of
/// earlier stages leave.
enum class Stage {
  path,   ///< how far the light goes: a cover, how deep it enters a surface, where the landmark stands
  light,  ///< what it is mixed with on the way
  spot,   ///< where the detector takes the spot of light to be
  number  ///< what is made of that
};

struct EffectInfo {
  std::string id;           ///< "range_eccentricity"; of an effect along a column "covariate_drift:supply_v"
  std::string number = {};  ///< by which code cites docs/effects.md, "R14"; may be empty
  EffectKind kind = EffectKind::mean;
  Carrier carrier =
      Carrier::not_known;       ///< light: it needs a lens or a beam; not_known: any sensor may have it
  Stage stage = Stage::number;  ///< where it acts
  std::string channel;          ///< words of docs/formats.md: range, bearing, stop, range_noise, ...
  std::string covariate;        ///< where its mismatch shows: range, disparity, sensor_bearing, time, ...
  std::string physics;          ///< one sentence a person can act on
  std::string formula;          ///< with symbols and units
  /// The change as a formula of docs/effects-by-formula.md, of one reading's d, f, b, ... and the parameters less their units
  /// ("cosine*cos(b) + sine*sin(b)"); empty where it is none.
  std::string expression = {};
  bool before_curve = false;  ///< the expression changes the distance, before the curve
  std::string source;         ///< where the formula comes from
  std::string visible_by;     ///< the design that makes it visible (a change of the experiment)
  std::string settled_by;     ///< what to record next to tell it from its twins
  SettledOfPairs settled_of_pairs = {};
  std::vector<std::string> switched_off_by = {};  ///< codes of experiments without it: lights off, say
  bool over_the_recording = false;  ///< its size is the change from the first reading to the last
  /// Its linear parameters are of one size, in units of what is typical of each: where one is far from that, all may be.
  bool sizes_alike = false;
  /// Effects, and `heading_zero` of the robot, that no reading of this sensor and robot can tell from it in any design.
  std::vector<std::string> exact_twins = {};
  std::vector<EffectParameter> parameters;
};

/// A covariate column over all readings of a job.
struct ColumnSummary {
  ColumnRole role = ColumnRole::other;
  double mean = 0.0,
         std_dev = 0.0;  ///< of the fields that hold a number, in the column's unit; 0: it never changes
};

/// What all readings of a job have in common.
struct EffectContext {
  RecordingKind kind = RecordingKind::landmarks;
  bool reads_bearings = true;            ///< false of landmarks by ranges alone
  Carrier carrier = Carrier::not_known;  ///< of the sensor, where its recording says it
  int stop_count = 0, landmark_count = 0;
  std::vector<std::string> landmark_labels;
  std::vector<double> landmark_radius_m;
  std::vector<Pose2> commanded;     ///< per stop
  std::vector<double> path_m;       ///< per stop: path length driven so far, 0 at the first
  std::vector<double> stop_time_s;  ///< per stop: time of its first reading, 0 at the start; empty: no times
  double duration_s = 0.0;          ///< last time minus first
  double largest_rate_mps = 0.0;    ///< of any true distance of kind pairs; 0 without times
  double stay_s = 0.0;              ///< longest time between two readings of one stop; 0 without times
  double range_min_m = 0.0, range_max_m = 0.0;  ///< of the true distances, as fitted
  double largest_cell = 1.0;                    ///< most repeats of one (stop, landmark)
  int longest_sequence = 0;  ///< readings of one device of kind pairs, without repeats; else 0
  double headings = 0.0;     ///< spread of the stops' headings [rad]
  bool several_radii = false;
  double largest_bearing_rad = 3.14159265358979;  ///< largest |direction in the sensor frame| of any reading
  std::vector<std::string> covariates;            ///< names of the covariate columns
  std::vector<ColumnSummary> columns;             ///< of each of them; empty: nothing is known but the names
  std::vector<std::string> left_out;  ///< ids of effects that are not asked for, along columns or not
};

/// One reading as its effects see it; geometry under the current estimate.
template <typename T>
struct ReadingView {
  T d;                        ///< true distance to the surface [m]
  T axis_distance;            ///< to the axis [m]
  T bearing;                  ///< predicted direction in the sensor frame [rad], (-pi, pi]
  T f, slope;                 ///< f(d) [m], f'(d)
  T curvature;                ///< f''(d) [1/m]
  T spread;                   ///< standard deviation of the reading [m]
  double before_light = 0.0;  ///< what effects on the path add to the range [m]
  double before_spot = 0.0;   ///< what effects on the path and on the light add to it [m]
  int spread_power = 0;       ///< p of the noise law s = sigma |f|^p
  double radius = 0.0;        ///< of the landmark [m]
  double heading = 0.0;       ///< of the stop, commanded [rad]
  double time_s = 0.0;        ///< since the first reading; 0 without times
  double time = 0.0;          ///< the same scaled to 0 .. 1 over the recording
  double rate_mps = 0.0;      ///< of the true distance of kind pairs; 0 where it is not known
  int stop = 0, landmark = 0, repeat = 0;
  const double* covariate = nullptr;  ///< values by EffectContext::covariates; NaN where empty
  const EffectContext* context = nullptr;

  /// Change of the reading when the distance before the curve changes by `delta` [m]: f(d + delta) - f(d).
  T before_curve(const T& delta) const { return delta * (slope + 0.5 * curvature * delta); }
  /// Change of log s^2 when the reading changes by `change` [m] before the curve, so that the spread goes along:
  /// 2 p log((f + change) / f), down to a tenth of f. Centimetres do not need it; halved distances do. Laws that are
  /// no power of f stay where they are.
  T spread_along(const T& change) const {
    using std::log;
    if (spread_power == 0 || !(f > 0.0)) return T(0.0);
    const T ratio = 1.0 + change / f;
    return 2.0 * spread_power * log(ratio > 0.1 ? ratio : T(0.1));
  }
};

/// What an effect adds to a reading.
template <typename T>
struct ReadingChange {
  T range{0.0};               ///< to the mean reading [m]
  T bearing{0.0};             ///< to the mean bearing [rad]
  T range_log_variance{0.0};  ///< to log s^2
  T bearing_log_variance{0.0};
};

/// How the errors of readings depend on one another: of the repeats of a cell in order of time, and where readings follow one
/// another without repeats (EffectContext::longest_sequence) of those of a device.
struct Dependence {
  double range_cell_sigma_m = 0.0;  ///< error shared by all repeats of a cell
  double bearing_cell_sigma_rad = 0.0;
  double range_correlation = 0.0;       ///< AR(1) from reading to reading
  double range_correlated_share = 1.0;  ///< of the variance, what is AR(1), in a sequence; the rest is white
  double bearing_correlation = 0.0;
};

/// Steps of the grid that the values sit on; 0: no grid.
struct GridSteps {
  double range_m = 0.0, bearing_rad = 0.0;
};

/// A reading as it was before rounding, or as it is written: the range infinite where none is.
struct GridReading {
  double range_m = 0.0, bearing_rad = 0.0;
};

/// A physical effect that a model may leave out. One file per effect in problems/effects; being there registers it.
class Effect {
 public:
  virtual ~Effect() = default;
  virtual const EffectInfo& info() const = 0;
  /// True if an effect of this kind lies along every column of that role, each with parameters of its own: it is `along` a
  /// column that changes readings, and stands for all of them in the catalogue.
  virtual bool lies_along(ColumnRole) const { return false; }
  /// The effect along the column of that name; null where it lies along none.
  virtual std::unique_ptr<Effect> along(const std::string& /*column*/) const { return nullptr; }
  /// What the recording lacks for this effect to be modelled (bearings, a column, repeats, times); empty if nothing.
  std::string lacking(const EffectContext& context) const;
  /// The same beside the channel that it acts on.
  virtual std::string missing(const EffectContext&) const { return {}; }
  /// Starts for the parameters that are not linear, one vector of all parameters each; linear ones at 0.
  virtual std::vector<Eigen::VectorXd> start_grid(const EffectContext&) const {
    return {Eigen::VectorXd::Zero(static_cast<Eigen::Index>(info().parameters.size()))};
  }
  /// Bounds of a parameter in this recording: by default those that physics sets, in info().
  virtual std::pair<double, double> bounds(const EffectContext&, std::size_t parameter) const;
  /// Change of one reading under parameters p.
  virtual ReadingChange<double> reading(const ReadingView<double>&, const double* /*p*/) const { return {}; }
  /// Change of that per unit of one parameter, where a formula gives it; else central differences do.
  virtual std::optional<ReadingChange<double>> slope(const ReadingView<double>&, const double* /*p*/,
                                                     int /*parameter*/) const {
    return std::nullopt;
  }
  /// False if reading() is the same at every distance, all else the same.
  virtual bool changes_with_distance() const { return true; }
  /// False if reading() is the same for all readings of one landmark from one stop, whenever they were taken.
  virtual bool differs_between_repeats() const { return true; }
  /// Change of the stops: commanded poses, sigmas, chain. `true` from acts_on_stops() makes it be called.
  virtual bool acts_on_stops() const { return false; }
  virtual void stops(const EffectContext&, const double* /*p*/, std::vector<StopPrior>&) const {}
  virtual Dependence dependence(const double* /*p*/) const { return {}; }
  /// What the user reads: names (ending in the unit) and values made from p, an amplitude and a phase from a cosine and
  /// a sine, say. By default the parameters themselves.
  virtual std::vector<std::pair<std::string, double>> reported(const EffectContext&, const double* p) const;
  /// Tail: which share of such readings misses, and by how much more than the spread, to both sides or to one.
  virtual Contamination contamination(const ReadingView<double>&, const double* /*p*/) const { return {}; }
  /// Grid: its steps where a reading lies.
  virtual GridSteps grid_steps(const ReadingView<double>&, const double* /*p*/) const { return {}; }
  /// Grid: a reading rounded to it, so that simulated values sit where read ones do.
  virtual GridReading rounded(const GridReading& reading, const double* /*p*/) const { return reading; }
  /// True if the noise of range is Gaussian in 1/r instead of r (before the reciprocal); reading() is then not used.
  virtual bool noise_before_reciprocal() const { return false; }
  /// Distance [m] at which reading() jumps under p; NaN if it does nowhere. On which side of it a reading near it lies
  /// is uncertain, and estimated with the rest; where it is one of the parameters, it is moved past them too.
  virtual double switching_distance(const double* p) const;
};

/// Start grids are products of axes: every combination of the given values, in order; axes of one 0 for linear ones.
std::vector<Eigen::VectorXd> grid_of(const std::vector<std::vector<double>>& axes);

/// All effects of problems/effects, the catalogue, ordered by id. Generated from the folder's files at configure time.
const std::vector<std::unique_ptr<Effect>>& effect_registry();
/// The catalogue's effects, then those that were added (formula_effect.hpp).
std::vector<const Effect*> known_effects();
/// The effect of that id, of the catalogue or added, or nullptr. "ID:COLUMN" is that effect along a column; the pointer stays valid.
const Effect* find_effect(const std::string& id);
/// The exact twins of the effect of that id; none of an id that is not known.
std::vector<std::string> exact_twins_of(const std::string& id);
/// The effects that a recording may hold: all that are known, with one for each column that such an effect may lie along.
std::vector<const Effect*> effects_of(const EffectContext& context);

/// The id in physics of an effect along a column: "covariate_drift" of "covariate_drift:supply_v".
std::string id_without_column(const std::string& id);
/// Its column; "" where it lies along none.
std::string column_in_id(const std::string& id);
/// As people read it: "covariate_drift along supply_v".
std::string id_in_words(const std::string& id);
/// Several of them with `between` in between.
std::string ids_in_words(const std::vector<std::string>& ids, const std::string& between);

}  // namespace rangecal
