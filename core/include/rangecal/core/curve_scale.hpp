// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <optional>
#include <string>

namespace rangecal {

/// What the curve f is a polynomial in.
enum class CurveFamily {
  polynomial,  ///< the distance: u = d (Alhashimi 2016, eq. 3)
  reciprocal   ///< its reciprocal: u = 1 / (d + c); of order 1 f = a + b / (d + c)
};

/// "polynomial", "reciprocal".
const char* to_string(CurveFamily family);
/// The inverse of to_string; throws InputError naming the accepted texts.
CurveFamily curve_family_from_string(const std::string& text);

/// The scale u(d) of a curve f(d) = sum_i alpha_i u^i. d, c in metres; u in metres (polynomial) or 1/m.
///
/// A triangulating sensor that gives a voltage or a disparity reads the reciprocal of the distance beyond its lens: a line
/// in u (the data sheets of infrared rangers state c). From order 2 on f may also turn around.
struct CurveScale {
  CurveFamily family = CurveFamily::polynomial;
  double offset_m = 0.0;               ///< c of the reciprocal; d + c > 0 at every distance of use
  std::optional<double> offset_std_m;  ///< where it was estimated and is determined

  bool is_distance() const { return family == CurveFamily::polynomial; }
  double of(double d) const { return is_distance() ? d : 1.0 / (d + offset_m); }
  /// u'(d)
  double slope(double d) const { return is_distance() ? 1.0 : -of(d) * of(d); }
  /// u''(d)
  double curvature(double d) const { return is_distance() ? 0.0 : 2.0 * of(d) * of(d) * of(d); }
  /// d of u; the reciprocal's u > 0
  double distance(double u) const { return is_distance() ? u : 1.0 / u - offset_m; }

  bool same_as(const CurveScale& other) const {
    return family == other.family && (is_distance() || offset_m == other.offset_m);
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
