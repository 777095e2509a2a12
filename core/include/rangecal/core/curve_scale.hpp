// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

#include "rangecal/core/natural_spline.hpp"

namespace rangecal {

/// What the curve f is a polynomial in.
enum class CurveFamily {
  polynomial,  ///< the distance: u = d (Alhashimi 2016, eq. 3)
  reciprocal,  ///< its reciprocal: u = 1 / (d + c); of order 1 f = a + b / (d + c)
  spline       ///< the distance bent by a spline that rises everywhere; of order 1 a smooth monotone curve
};

/// "polynomial", "reciprocal", "spline".
const char* to_string(CurveFamily family);
/// The inverse of to_string; throws InputError naming the accepted texts.
CurveFamily curve_family_from_string(const std::string& text);

/// u(d) of a curve without a formula: a natural cubic spline, as far from the distance as the readings ask for.
struct SplineScale {
  NaturalSpline u;             ///< rises everywhere, from 0 at the distance 0 [m]
  Eigen::MatrixXd covariance;  ///< of its values at the knots, but for what alpha takes up [m^2]
  double degrees = 2.0;        ///< effective degrees of freedom of the curve, the two of a line among them

  /// Variance of u(d) [m^2].
  double variance(double d) const {
    const Eigen::VectorXd N = u.weights(d);
    return N.dot(covariance * N);
  }
};

/// The scale u(d) of a curve f(d) = sum_i alpha_i u^i. d, c in metres; u in metres (polynomial, spline) or 1/m.
///
/// A triangulating sensor that gives a voltage or a disparity reads the reciprocal of the distance beyond its lens: a line
/// in u (the data sheets of infrared rangers state c). From order 2 on f may also turn around.
struct CurveScale {
  CurveFamily family = CurveFamily::polynomial;
  double offset_m = 0.0;               ///< c of the reciprocal; d + c > 0 at every distance of use
  std::optional<double> offset_std_m;  ///< where it was estimated and is determined
  std::optional<SplineScale> spline = std::nullopt;  ///< of the spline

  bool is_distance() const { return family == CurveFamily::polynomial; }
  bool is_reciprocal() const { return family == CurveFamily::reciprocal; }
  double of(double d) const {
    if (is_distance()) return d;
    return is_reciprocal() ? 1.0 / (d + offset_m) : spline->u(d);
  }
  /// u'(d)
  double slope(double d) const {
    if (is_distance()) return 1.0;
    return is_reciprocal() ? -of(d) * of(d) : spline->u.slope(d);
  }
  /// u''(d)
  double curvature(double d) const {
    if (is_distance()) return 0.0;
    return is_reciprocal() ? 2.0 * of(d) * of(d) * of(d) : spline->u.curvature(d);
  }
  /// d of u; the reciprocal's u > 0
  double distance(double u) const {
    if (is_distance()) return u;
    return is_reciprocal() ? 1.0 / u - offset_m : spline->u.inverse(u);
  }
  /// Parameters that were estimated, beside alpha.
  double parameters() const {
    if (is_distance()) return 0.0;
    return is_reciprocal() ? 1.0 : spline->degrees - 2.0;
  }

  bool same_as(const CurveScale& other) const {
    if (family != other.family) return false;
    if (is_distance()) return true;
    if (is_reciprocal()) return offset_m == other.offset_m;
    const NaturalSpline &own = spline->u, &another = other.spline->u;
    return own.knots().size() == another.knots().size() && own.knots() == another.knots() &&
           own.values() == another.values();
  }
};

/// A curve and its derivatives in d.
struct CurveDerivatives {
  double f = 0.0, slope = 0.0, curvature = 0.0;  ///< f [m], f', f'' [1/m]
};

/// Of f(d) = sum_i alpha_i u^i, by Horner's rule in u and the chain rule.
inline CurveDerivatives curve_derivatives(const Eigen::VectorXd& alpha, const CurveScale& scale, double d) {
  const double u = scale.of(d), u_slope = scale.slope(d);
  CurveDerivatives in_u;
  for (Eigen::Index i = alpha.size(); i-- > 0;) {
    in_u.curvature = in_u.curvature * u + 2.0 * in_u.slope;
    in_u.slope = in_u.slope * u + in_u.f;
    in_u.f = in_u.f * u + alpha[i];
  }
  return {in_u.f, in_u.slope * u_slope, in_u.curvature * u_slope * u_slope + in_u.slope * scale.curvature(d)};
}

}  // namespace rangecal
