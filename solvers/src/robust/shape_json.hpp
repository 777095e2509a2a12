// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>

#include "rangecal/problems/noise_shape.hpp"

namespace rangecal {

/// A noise shape with all its parameters as a list in the states of what goes on later, and back. Throws InputError for a
/// family that is none; the JSON library's exceptions for a list that is not whole.
template <typename Json>
Json shape_list(const NoiseShapeParameters& shape) {
  return {to_string(shape.shape), shape.nu, shape.outlier_share, shape.outlier_scale, shape.outlier_mean};
}
template <typename Json>
NoiseShapeParameters shape_in_list(const Json& json) {
  return {noise_shape_from_string(json.at(0).template get<std::string>()), json.at(1), json.at(2), json.at(3),
          json.at(4)};
}

}  // namespace rangecal
