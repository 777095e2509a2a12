// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>

namespace rangecal {

/// A natural cubic spline g through values at knots: cubic between them with two continuous derivatives, straight beyond the outer
/// ones. Of all curves through its values it has the least roughness, the integral of g''^2.
///
/// Between knots t_j and t_j+1, h apart, with values g_j and second derivatives c_j,
///
///   g(x) = ((x - t_j) g_j+1 + (t_j+1 - x) g_j) / h
///          - (x - t_j) (t_j+1 - x) ((1 + (x - t_j) / h) c_j+1 + (1 + (t_j+1 - x) / h) c_j) / 6,     c = G g
///
/// Source: Green and Silverman 1994, section 2.
class NaturalSpline {
 public:
  NaturalSpline() = default;
  /// True of three finite numbers or more, in ascending order.
  static bool are_knots(const Eigen::VectorXd& knots);
  /// `values`: as many as knots. Throws InputError for others, and for what are no knots.
  NaturalSpline(Eigen::VectorXd knots, Eigen::VectorXd values);

  const Eigen::VectorXd& knots() const { return knots_; }
  const Eigen::VectorXd& values() const { return values_; }

  double operator()(double x) const;
  double slope(double x) const;
  double curvature(double x) const;
  /// The least slope, which a spline takes at one of its knots or between two where its curvature is 0.
  double least_slope() const;
  /// Of a spline that rises everywhere: the x with g(x) = value, to within rounding.
  double inverse(double value) const;

  /// N(x), with g(x) = N(x)^T g for every spline of these knots.
  Eigen::VectorXd weights(double x) const;
  /// B [knots x knots - 2]: the spline through values B b has the roughness b^T b, and every spline is one of these and a straight line.
  Eigen::MatrixXd bends() const;

 private:
  /// The interval that x is in, and how far into it.
  struct Place {
    Eigen::Index left;
    double h, from_left, to_right;
  };
  Place place(double x) const;
  /// Slope at the left end of an interval, and at its right.
  double slope_at_left(Eigen::Index j) const;
  double slope_at_right(Eigen::Index j) const;

  Eigen::VectorXd knots_, values_, curvatures_;
  Eigen::MatrixXd curvatures_by_values_;  ///< G, by row
};

}  // namespace rangecal
