// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/outcome.hpp"
#include "rangecal/problems/world/scene.hpp"

namespace rangecal {

/// What an experiment takes [s].
struct PlanCosts {
  double place_s = 30.0;     ///< to drive to a place and settle
  double turn_s = 10.0;      ///< to turn the sensor on the spot
  double landmark_s = 60.0;  ///< to put up a landmark
  double scan_s = 0.2;       ///< one repeat: all landmarks at once
};

struct PlanRequest {
  /// The sensor (alpha, noise, sigma_theta, range), how uncertain stops are, what is visible; its stops, landmarks and
  /// repeats are what is planned. Positions: `random_landmarks` gives the room, else the box around what it has.
  Scene sketch;
  double accuracy_m =
      0.01;  ///< wanted: standard deviation of a corrected distance by the calibration, at most, over
  double low_m = 0.5, high_m = 4.0;
  std::vector<std::string>
      effects;  ///< of the catalogue, worried about: nuisances that the plan must tell apart
  std::vector<double> radii_m{0.05};  ///< of the landmarks at hand
  PlanCosts costs;
  int most_places = 40, most_landmarks = 6, most_repeats = 50;

  /// Throws InputError naming the bad field and its value.
  void check() const;
};

/// Whether a design shows an effect of its typical size.
struct PlanEffect {
  std::string id;
  bool seen = false;         ///< with probability 0.8 at an alarm rate of 0.02 for the effects asked about
  double noncentrality = 0;  ///< of the likelihood-ratio test at the typical size
  double harm_m = 0.0;       ///< RMS error in corrected distance that it costs unseen
};

struct PlanDesign {
  std::string path;  ///< "line", "diagonal", "two legs", "loop"
  int places = 0, headings = 1, repeats = 1;
  std::vector<Stop> stops;  ///< places x headings
  std::vector<Eigen::Vector2d> landmarks;
  std::vector<double> radius_m;
  double std_dev_m = 0.0;  ///< largest over [low, high]: what `accuracy_m` asks for
  double minutes = 0.0;
  std::vector<PlanEffect> effects;
};

struct Plan {
  Outcome outcome = Outcome::
      failed;  ///< converged: the accuracy is reached; not_converged: `best` is the most accurate found
  std::string reason;
  PlanDesign best;
  std::optional<PlanDesign>
      line;  ///< the papers' design that reaches the accuracy soonest: a straight line, no turns,
             ///< five landmarks at both sides; none where none does
  std::optional<double> line_std_dev_m;  ///< the most accurate line within the limits, where none reaches it
  int evaluated = 0;                     ///< designs whose information was computed
};

/// Proposes the experiment that reaches an accuracy in the fewest minutes. The calibration's covariance is the inverse of
/// the expected information of alpha, landmarks, stops (with their prior) and the effects' parameters b ~ N(0, typical^2):
///
///   C = C_0 + A (X^T P X + B^-1)^-1 A^T,     P = W - W J K^-1 J^T W,    A = K^-1 J^T W X,
///
/// J the readings' derivatives in alpha, landmarks and stops, W their weights, K = J^T W J + prior, X the effects'
/// derivatives, C_0 = K^-1 on alpha. The criterion is c-optimal (Elfving 1952; Pukelsheim, Optimal Design of Experiments,
/// ch. 2): the largest sqrt(phi(d)^T C phi(d)) / f'(d) over nine distances. Landmarks by exchange over a grid of the room
/// for each path, number of headings and number of landmarks; places and repeats by trying all. Deterministic. Throws
/// InputError for a request that cannot be planned. Cost: some 20 000 informations, seconds.
Plan plan_experiment(const PlanRequest& request);

/// The scene of a design: the sketch with its stops, landmarks and repeats.
Scene planned_scene(const PlanRequest& request, const PlanDesign& design);

/// The criterion at any design, with its effects filled in; for comparisons.
PlanDesign evaluate_design(const PlanRequest& request, PlanDesign design);

}  // namespace rangecal
