// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/distributions.hpp"

#include <boost/math/distributions/chi_squared.hpp>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/normal.hpp>
#include <boost/math/distributions/students_t.hpp>
#include <cmath>
#include <numbers>

namespace rangecal {

using boost::math::chi_squared;
using boost::math::complement;
using boost::math::fisher_f;
using boost::math::normal;
using boost::math::students_t;

double normal_below(double z) { return 0.5 * std::erfc(-z / std::numbers::sqrt2); }

double normal_two_sided(double z) { return std::erfc(std::abs(z) / std::numbers::sqrt2); }

double normal_quantile(double p) { return quantile(normal(), p); }

double normal_upper_quantile(double q) { return quantile(complement(normal(), q)); }

double chi_squared_upper(double x, double degrees) { return cdf(complement(chi_squared(degrees), x)); }

double chi_squared_quantile(double p, double degrees) { return quantile(chi_squared(degrees), p); }

double chi_squared_upper_quantile(double q, double degrees) {
  return quantile(complement(chi_squared(degrees), q));
}

double student_t_quantile(double p, double degrees) { return quantile(students_t(degrees), p); }

double log_gamma(double x) {
  int sign = 1;
  return ::lgamma_r(x, &sign);
}

double fisher_f_upper(double x, double numerator, double denominator) {
  return cdf(complement(fisher_f(numerator, denominator), x));
}

}  // namespace rangecal
