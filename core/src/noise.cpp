// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/noise.hpp"

#include <cmath>

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

Noise::LogSlopes Noise::log_slopes(double d, double f) const {
  const NoiseForm form = form_of(law);
  if (!form.has_sigma) return {0.0, evaluate_derivative(parameters, d) / evaluate_polynomial(parameters, d)};
  return {form.power_of_f > 0 ? form.power_of_f / f : 0.0, form.power_of_d > 0 ? form.power_of_d / d : 0.0};
}

}  // namespace rangecal
