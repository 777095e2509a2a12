// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/noise.hpp"

#include <cmath>
#include <limits>

#include "rangecal/core/names.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {
namespace {

constexpr auto law_names = names_of<NoiseLaw>("noise law", {{NoiseLaw::constant, "constant"},
                                                            {NoiseLaw::f, "f"},
                                                            {NoiseLaw::f_squared, "f2"},
                                                            {NoiseLaw::f_cubed, "f3"},
                                                            {NoiseLaw::d_squared, "d2"},
                                                            {NoiseLaw::polynomial, "polynomial"}});

}  // namespace

const char* to_string(NoiseLaw law) { return law_names.name_of(law); }

NoiseLaw noise_law_from_string(const std::string& text) { return law_names.value_of(text); }

double Noise::spread(double d, double f) const {
  const NoiseForm form = form_of(law);
  if (!form.has_sigma) return evaluate_polynomial(parameters, d);
  double s = parameters[0];
  for (int i = 0; i < form.power_of_f; ++i) s *= std::abs(f);
  for (int i = 0; i < form.power_of_d; ++i) s *= d;
  return s;
}

Noise::LogSpread Noise::log_spread(double d, double f) const {
  const NoiseForm form = form_of(law);
  const double s = spread(d, f);
  LogSpread at;
  at.value = s > 0.0 ? std::log(s) : std::numeric_limits<double>::quiet_NaN();
  if (!form.has_sigma) {
    at.by_d = evaluate_derivative(parameters, d) / s;
    return at;
  }
  if (form.power_of_f > 0) at.by_f = form.power_of_f / f;
  if (form.power_of_d > 0) at.by_d = form.power_of_d / d;
  return at;
}

}  // namespace rangecal
