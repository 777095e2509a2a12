// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <span>

#include "rangecal/solvers/extract/circle_fit.hpp"

namespace rangecal {

/// How round a landmark is, from all its sightings together. Of one sighting, in the frame of its fitted
/// circle (axis at distance D in direction b, radius R), a hit lies at
///   X = r cos(bearing - b),   Y = r sin(bearing - b)          [m]
///   X = c + t Y + a h(Y) + l R (Y / R)^3 + N(0, sigma^2),   h(Y) = R - sqrt(R^2 - Y^2)
/// with c and t of each sighting its own: the circle has a = 1, l = 0; a straight face at any angle a = 0; a
/// box seen over its corner a = 1.6; a cylinder of another radius R' about a = R / R'; what is lopsided l.
/// Least squares over all sightings, beams independent, with l ~ N(0, 0.5^2) beforehand.
class Roundness {
 public:
  /// The hits of one sighting that pass its axis at no more than `edge_cut` of R.
  void add(std::span<const Beam> beams, const CircleFit& fit, double sigma_m, double edge_cut);

  int most_hits() const { return most_hits_; }  ///< fitted in one sighting
  struct Shape {
    double bow = 0.0, bow_sd = 0.0;    ///< a
    double lean = 0.0, lean_sd = 0.0;  ///< l
  };
  /// Infinite standard deviations where nothing is known.
  Shape shape() const;

 private:
  Eigen::Matrix2d information_ = Eigen::Vector2d(0.0, 4.0).asDiagonal();
  Eigen::Vector2d moment_ = Eigen::Vector2d::Zero();
  int most_hits_ = 0;
};

}  // namespace rangecal
