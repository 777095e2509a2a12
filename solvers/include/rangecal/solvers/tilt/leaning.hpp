// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/calibration.hpp"
#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal {

/// Out of the plane: the tilt of the scan plane and the leans of the cylinders as unknowns of the joint
/// likelihood, beside curve, noise, stops and landmarks.
///
/// Measured: range and bearing of cylinders by a plane tilted by tau about the level axis in direction b0 of
/// the sensor. Symbols:  D distance to the axis [m], d to the surface [m], b bearing in the sensor's frame,
/// phi = heading + b [rad];
///           n = (cos phi, sin phi), t = (-sin phi, cos phi); l slope of a cylinder's axis towards the
///           world's x and y [m/m], |l| the tangent of its lean; where the axis meets the sensor's height is
///           the landmark.
/// Equation: the plane meets the cylinder at the height z above the sensor, where its axis has moved by z l:
///
///   z = D tan(tau) sin(b - b0)
///   delta d = 1/4 d (tau^2 - tau^2 cos 2(b - b0)) + z l.n     [m]     the plane's stretch (effect `tilt`),
///   and the lean delta b = 1/4 tau^2 sin 2(b - b0) + z l.t / D             [rad]
///
/// Only products w = tan(tau) l are in the readings. So in a level plane no design sees a lean (the cut is
/// then an ellipse, its half-axes r and r / cos(lean), about a centre that stands still), and a plane tilted
/// the other way among cylinders that lean the other way gives the same readings: leans are known up to one
/// sign for all of them, b0 is taken from
/// [-pi/2, pi/2). Source: ours, to first order in the lean; 2021 section 6 names the question.
struct LeaningOptions {
  CalibrateOptions calibrate;  ///< order, noise law, start; the method is `marginal`
  double p_value = 0.01;  ///< leans are taken into the answer where chance alone gains as much more seldom
  double seen_std =
      0.0873;  ///< standard deviation of a slope beyond which a lean is not seen [m/m]: 5 degrees
};

/// The lean of one cylinder.
struct LeanEstimate {
  std::string landmark;
  int recording = 0;
  bool seen = false;
  Eigen::Vector2d slope = Eigen::Vector2d::Zero();           ///< l, towards the world's x and y
  Eigen::Matrix2d covariance = Eigen::Matrix2d::Zero();      ///< of l
  double lean_rad = 0.0, low95_rad = 0.0, high95_rad = 0.0;  ///< atan |l|
};

struct LeaningFit {
  Outcome outcome = Outcome::failed;
  std::string reason;
  EffectEstimate tilt, axis;  ///< [rad]; of the model that is stood by
  /// By its information the design tells a tilt of 10 degrees from none, whatever the readings say.
  bool design_sees = false;
  bool tilt_seen =
      false;  ///< its 95 % interval does not hold 0 and ends below 15 degrees, half as much again as is searched
  bool leans_seen = false;                  ///< leans are in the answer
  double tilt_gain = 0.0, lean_gain = 0.0;  ///< nats
  double lean_p_value = 1.0;                ///< of as large a gain where every cylinder is plumb
  std::vector<LeanEstimate> leans;          ///< empty where the plane is not seen to be tilted
  std::string statement;                    ///< what is seen and what this design cannot see, in words
  Calibration calibration;                  ///< with effect `tilt` where it is seen
  std::vector<ModelScore> models;           ///< of which the seed model was chosen; empty where it was given
};

/// Fits the seed model, the tilted plane and, where that is seen, the leans, each by marginal ML. Throws
/// InputError for recordings of pairs. Cost: some 30 marginal solves.
LeaningFit fit_leaning(std::span<const Recording> recordings, const LeaningOptions& options = {});

}  // namespace rangecal
