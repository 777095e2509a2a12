// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <string>

namespace rangecal {

/// How the standard deviation s [m] of a range reading depends on the true distance d [m] through f = f(d).
enum class NoiseLaw {
  constant,   ///< s = sigma                    (H0 of Alhashimi 2016, eq. 10)
  f,          ///< s = sigma |f|                (H1)
  f_squared,  ///< s = sigma f^2                (H2, the triangulation law, 2016 eq. 1)
  f_cubed,    ///< s = sigma |f|^3              (H3)
  d_squared,  ///< s = sigma d^2                (2016 eq. 21)
  polynomial  ///< s = sum_i beta_i d^i         (2021 eq. 3, 4)
};

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
  /// The power p of f in s = sigma |f|^p; 0 for constant, d_squared and polynomial.
  int power_of_f() const;
};

}  // namespace rangecal
