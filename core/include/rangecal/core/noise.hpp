// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

namespace rangecal {

/// How the standard deviation s [m] of a range reading depends on the true distance d [m] through f = f(d). What each is
/// made of stands in `form_of`; what else a new law needs is in CONTRIBUTING.md.
enum class NoiseLaw {
  constant,   ///< s = sigma                    (H0 of Alhashimi 2016, eq. 10)
  f,          ///< s = sigma |f|                (H1)
  f_squared,  ///< s = sigma f^2                (H2, the triangulation law, 2016 eq. 1)
  f_cubed,    ///< s = sigma |f|^3              (H3)
  d_squared,  ///< s = sigma d^2                (2016 eq. 21)
  polynomial  ///< s = sum_i beta_i d^i         (2021 eq. 3, 4)
};

/// s = sigma |f|^p d^q, of one parameter sigma > 0; or the polynomial in d, of parameters beta.
struct NoiseForm {
  int power_of_f = 0, power_of_d = 0;  ///< p, q
  bool has_sigma = true;               ///< false: the polynomial
};

constexpr NoiseForm form_of(NoiseLaw law) {
  switch (law) {
    case NoiseLaw::constant:
      return {0, 0};
    case NoiseLaw::f:
      return {1, 0};
    case NoiseLaw::f_squared:
      return {2, 0};
    case NoiseLaw::f_cubed:
      return {3, 0};
    case NoiseLaw::d_squared:
      return {0, 2};
    case NoiseLaw::polynomial:
      return {0, 0, false};
  }
  return {};
}

/// True of the laws of one sigma, whose logarithm is what estimators move; false of the polynomial.
constexpr bool has_sigma(NoiseLaw law) { return form_of(law).has_sigma; }
/// True of s = sigma |f|^p, p = 0 among them: the spread knows the distance through the curve alone.
constexpr bool is_power_of_f(NoiseLaw law) { return has_sigma(law) && form_of(law).power_of_d == 0; }
/// Parameters of a law; a polynomial's has the degree `order`.
constexpr int parameter_count(NoiseLaw law, int order) { return has_sigma(law) ? 1 : order + 1; }

/// "constant", "f", "f2", "f3", "d2", "polynomial".
const char* to_string(NoiseLaw law);
/// The inverse of to_string; throws InputError naming the accepted texts.
NoiseLaw noise_law_from_string(const std::string& text);

/// A noise law with its parameters.
struct Noise {
  NoiseLaw law = NoiseLaw::f_squared;
  /// sigma for the power laws (one number; unit m^(1-power)), beta for the polynomial (beta_i in m^(1-i)).
  Eigen::VectorXd parameters = Eigen::VectorXd::Constant(1, 0.01);

  /// s(d) in metres, given f = f(d).
  double spread(double d, double f) const;
  /// Slopes of log s in f (d held) and in d (f held), where s is positive.
  struct LogSlopes {
    double by_f = 0.0, by_d = 0.0;
  };
  LogSlopes log_slopes(double d, double f) const;
  /// p of s = sigma |f|^p d^q; 0 for the polynomial.
  int power_of_f() const { return form_of(law).power_of_f; }
};

}  // namespace rangecal
