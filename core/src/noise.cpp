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
  switch (law) {
    case NoiseLaw::constant:
      return parameters[0];
    case NoiseLaw::f:
      return parameters[0] * std::abs(f);
    case NoiseLaw::f_squared:
      return parameters[0] * f * f;
    case NoiseLaw::f_cubed:
      return parameters[0] * std::abs(f) * f * f;
    case NoiseLaw::d_squared:
      return parameters[0] * d * d;
    case NoiseLaw::polynomial:
      return evaluate_polynomial(parameters, d);
  }
  return parameters[0];
}

int Noise::power_of_f() const {
  switch (law) {
    case NoiseLaw::f:
      return 1;
    case NoiseLaw::f_squared:
      return 2;
    case NoiseLaw::f_cubed:
      return 3;
    default:
      return 0;
  }
}

}  // namespace rangecal
