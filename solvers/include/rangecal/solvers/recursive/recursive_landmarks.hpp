// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/problems/landmarks/joint_problem.hpp"
#include "rangecal/solvers/recursive/recursive_bearings.hpp"
#include "rangecal/solvers/robust/robust.hpp"

namespace rangecal {

class JsonFields;
struct LandmarkSums;
struct LastPose;
struct SigmaGrid;
struct ChannelResiduals;
class ResidualSketch;

struct RecursiveLandmarksOptions {
  std::optional<int> order = 2;        ///< of f; nullopt: the lowest AIC of 1 .. max_order at each estimate
  int max_order = 3;                   ///< of that search
  NoiseLaw law = NoiseLaw::f_squared;  ///< every law but `polynomial`
  NoiseShape noise_shape = NoiseShape::automatic;  ///< of ranges and of bearings, each for itself
  double sigma_xy_m = 0.01,
         sigma_heading_rad = 0.0;  ///< of stops that do not say how far they may be from their pose
  bool random_walk = false;        ///< these are errors of the step from the stop before, which add up
  double sigma_theta_rad =
      0.01;  ///< of one bearing, in the weights of from_bearings(); estimate() finds its own
  /// Time constant: a stop counts by exp(-age / forget), age in stops, taken in steps of `block` stops;
  /// infinite: nothing is forgotten.
  double forget = std::numeric_limits<double>::infinity();
  int block = 32;  ///< stops that are kept as they came, the latest, before they are summed up

  /// Throws InputError naming the bad field and its value.
  void check() const;
  int columns() const { return order.value_or(max_order) + 1; }
};

/// One reading of a landmark, with the stop it was made from.
struct LandmarkReading {
  Stop stop;  ///< label, commanded pose, how far it may be from there, place
  std::string landmark;
  double radius_m = 0.0;  ///< taken at the landmark's first reading
  double range_m = 0.0, bearing_rad = 0.0;
};

/// Calibrates from readings of landmarks in unknown places (the 2021 problem), stop after stop, in memory
/// that depends on the number of landmarks alone (Alhashimi 2016, section 6, asks for recursive schemes).
/// Stops have independent errors or those of a random walk; the readings of one stop follow each other.
///
/// estimate() is the answer of `marginal` (solve_marginal). The latest `block` stops are held as cells. When
/// they are full they are summed up (LandmarkSums): l_s, the likelihood with the stops' poses integrated out,
/// of third order in alpha and landmarks about the estimate with these stops in it, interpolated over the
/// sigmas. Each estimate expands the stops held at the last answer, adds the sums, solves, and does so again
/// until nothing moves (iterated updates). What the third order leaves out falls with the readings faster
/// than the standard deviations: the batch's answer within 1 % of its standard deviation.
///
/// Expansions are good near the answer about which they were made. Where the readings have an error that the model
/// lacks (ranges of a camera that are off alike at a stop), that of the first stops lies many of its standard deviations
/// from that of all. Hence the first 256 stops and up to a block more are kept as they came, too, and are expanded anew
/// about their common answer when they have doubled and where the sums have no optimum. Not along a random walk, and not
/// with forgetting.
///
/// Along a random walk the past is tied to what comes by the pose of the last stop alone. When stops are summed
/// up that pose stays, with its law given phi (LastPose), and the next stops are held together with it. Where
/// the whole stands and how it is turned only the first stop tells, and nothing that comes tells it better: in
/// the sums that stop is exact. With C_1 its covariance, Q = dphi / d(first pose) of a motion of the whole and
/// A = d2 l_s / dphi2, 1/2 log det(1 + C_1 Q^T A Q) is added to l_s at the end, phi shifted by its slope, and
/// Q C_1 Q^T added to the covariance.
///
/// With forgetting a stop counts by its weight w. The covariance is H^-1 J H^-1, H = sum w I and J = sum w^2 I, I the
/// information of a stop: a second LandmarkSums has the weights squared. Where the sums make no J of H's
/// kind, it is H^-1, which is never less, since w <= 1.
///
/// Noise shapes. Readings are held as rows, those of one stop that are alike within a quarter of their spread as one. A block
/// is summed up as the Gaussian readings that its rows stand for under the shapes at the estimate (weighted_problem):
/// expectation and maximisation (Dempster, Laird, Rubin 1977) with the expectation of each block taken once, of the stops kept
/// as they came as often as these are expanded anew. The shapes are those of solve_marginal_robust while all is kept, later
/// fitted to a sketch of all residuals (Cappe and Moulines 2009, J. R. Statist. Soc. B 71, 593, for online expectation and
/// maximisation); they are chosen from the sketch and the residuals of the stops held, about stops that the readings which
/// agree with the map place. The covariance counts what readings of the shapes tell (robust_covariance.hpp); along a random
/// walk it is enlarged as if every reading told as little as those of the channel that tells least.
///
/// from_bearings() is the linear part, 2021 eq. 18-25, by RecursiveBearings: the batch's answer to rounding.
class RecursiveLandmarks {
 public:
  explicit RecursiveLandmarks(const RecursiveLandmarksOptions& options = {});
  ~RecursiveLandmarks();
  RecursiveLandmarks(RecursiveLandmarks&&) noexcept;
  RecursiveLandmarks& operator=(RecursiveLandmarks&&) noexcept;

  /// Takes one reading. False, with the reason counted, for one that is not finite, zero or negative. Throws
  /// InputError for a stop that comes back after others (as far as the stops held go), an accuracy that is
  /// negative or not finite, and a pose that is not finite. Cost: 0.1 us; the `block`-th stop costs an
  /// estimate and the summing up.
  bool add(const LandmarkReading& reading);

  /// A stop of a random walk from which nothing was read: its step counts. Throws as add does.
  void pass(const Stop& stop);
  /// Label of the latest stop, empty before the first.
  std::string last_stop() const { return held_labels_.empty() ? "" : held_labels_.back(); }

  /// Outcomes: converged; too_few_data; what solve_marginal says while nothing is summed up; unobservable;
  /// not_converged where the answer still moves, or the search for the sigmas stopped short of their optimum.
  /// Cost: some 100 assemblies of the stops held, 1 ms with five landmarks.
  Calibration estimate();

  /// That range or bearing of a reading is an outlier, by what was summed up before: of a landmark that was, seen from within
  /// the stop's accuracy. None for others, before that, and along a random walk, whose stops are nowhere in particular.
  std::optional<double> outlier_probability(const LandmarkReading& reading) const;

  /// The landmarks from their bearings alone, in the order of their first reading, with the weights
  /// `consistent`.
  std::vector<LandmarkFromBearings> from_bearings() const;

  /// Counts a reading that the caller has a reason not to use.
  void drop(const std::string& reason);

  const RecursiveLandmarksOptions& options() const { return options_; }
  const Counts& counts() const { return counts_; }
  std::int64_t used() const { return used_; }    ///< readings
  std::int64_t stops() const { return stops_; }  ///< distinct stops seen
  /// Of these without an optimum beside the others: their readings count as dropped `at stops without an optimum`.
  std::int64_t stops_left_out() const { return stops_left_out_; }
  double effective_stops() const;  ///< (sum w)^2 / sum w^2 of those that are in the answer
  const std::vector<std::string>& landmarks() const { return labels_; }

  /// `rangecal-recursive-landmarks/3`: the whole state as JSON; doubles survive bit by bit.
  std::string to_json() const;
  /// Takes states of versions 1 and 2 too, which know Gaussian noise alone. Those of version 1 keep no second sums: where
  /// they forget, these begin as the first times sum w^2 / sum w. Throws InputError naming `name` and the field for a text
  /// that is no such state.
  static RecursiveLandmarks from_json(const std::string& text, const std::string& name);

 private:
  struct Answer;
  struct Saved;
  friend void fields(JsonFields& json, RecursiveLandmarks& tracked);  ///< of the state
  void hold_again(const JsonFields& json, const Saved& saved);
  void check_sums(const JsonFields& json) const;
  StopPrior prior_of(const Stop& stop) const;
  void open_stop(const Stop& stop);
  void hold(const std::string& label, StopPrior prior, const std::string* new_place);
  bool looks_for_outliers() const { return options_.noise_shape != NoiseShape::gaussian; }
  std::size_t cell_of(int landmark);
  std::size_t new_cell(std::size_t at, int landmark);
  std::size_t row_of(int landmark, double range_m, double bearing_rad);
  JointProblem held_cells(const JointState& state, const std::optional<RobustShapes>& shapes) const;
  std::optional<LandmarkSums> expand_held(Answer& answer, const SigmaGrid& grid,
                                          const Eigen::VectorXd& reference, const LastPose* last_pose) const;
  void settle_held(JointState& state) const;
  void take_shapes_into(Answer& answer) const;
  std::optional<RobustShapes> shapes_beside(const JointState& state) const;
  NoiseShapeParameters shape_beside(const NoiseShapeParameters& own, const ChannelResiduals& residuals,
                                    std::span<const NoiseShape> families) const;
  double readings_counted() const;
  double typical_spread(const JointState& state) const;
  Eigen::MatrixXd gap_of(const JointProblem& cells, const JointState& state,
                         const RobustShapes& shapes) const;
  Eigen::MatrixXd information_gap(const Answer& answer, const Eigen::MatrixXd& summed, double weight) const;
  void take_residuals(const JointProblem& rows, const JointState& state);
  void renew_shapes();
  int landmark_of(const LandmarkReading& reading);
  RecursiveBearings::Line line_of(const Cells& cells, std::size_t cell) const;
  void add_latest_lines(std::vector<RecursiveBearings>& bearings) const;
  Answer answer(int order) const;
  Answer first_answer(const JointProblem& stops, int order) const;
  Answer from_sums(int order) const;
  void sum_up();
  bool sum_up_held();
  void grow_past();
  bool sum_up_anew();
  void drop_held();
  void clear_held();
  void hold_last_pose();
  int own_stops() const { return held_.stop_count() - (anchored_ ? 1 : 0); }
  JointState start_of_held() const;
  void add_first_pose(Answer& answer, const Eigen::MatrixXd& hessian,
                      const std::vector<Eigen::MatrixXd>& third) const;
  Calibration calibration_of(const Answer& answer) const;

  RecursiveLandmarksOptions options_;
  JointProblem
      held_;  ///< the stops held; cells carry the repeats, or a row each where outliers are looked for
  bool anchored_ = false;  ///< the first of them is the last one summed up: its readings are in the sums
  Eigen::Matrix3d walked_ = Eigen::Matrix3d::Zero();  ///< random walk: covariance of the latest stop's pose,
  Eigen::Matrix3d first_covariance_ = Eigen::Matrix3d::Zero();  ///< of the first stop's
  Eigen::Vector2d first_position_m_ = Eigen::Vector2d::Zero();
  int tried_at_ = 0;  ///< stops held when they could last not be summed up; 0: that was not tried
  std::vector<std::string> held_labels_;
  std::vector<std::string> held_places_;     ///< by the number of the place
  std::vector<std::string> labels_;          ///< of the landmarks
  std::vector<RecursiveBearings> bearings_;  ///< per landmark
  std::unique_ptr<LandmarkSums> sums_;
  std::unique_ptr<LandmarkSums> squared_;  ///< with forgetting: the same by the squares of the weights
  std::unique_ptr<JointProblem> past_;     ///< the stops summed up as they came; null once they are too many
  int anew_stops_ = 0;                     ///< of these when they were last expanded about one answer
  std::optional<RobustShapes> shapes_;     ///< of what was summed up; none: Gaussian
  std::unique_ptr<ResidualSketch> range_residuals_, bearing_residuals_;  ///< of the same
  Eigen::MatrixXd gap_,
      squared_gap_;   ///< what readings of the shapes tell of phi beyond the sums; and by squared weights
  int outliers_ = 0;  ///< readings summed up that the shapes take for such
  std::optional<JointState> last_;  ///< alpha, noise, sigma_theta and landmarks of the last answer
  Counts counts_;
  std::int64_t used_ = 0, stops_ = 0, stops_left_out_ = 0;
  double sum_w_ = 0.0, sum_w_sq_ = 0.0;                                    ///< over stops summed up
  double low_m_ = std::numeric_limits<double>::infinity(), high_m_ = 0.0;  ///< of the distances summed up
};

}  // namespace rangecal
