// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"

namespace rangecal {

/// Vectors and matrices, the latter column by column, as lists of numbers in the states of what goes on later.
inline nlohmann::ordered_json list(const Eigen::VectorXd& values) {
  return std::vector<double>(values.begin(), values.end());
}
inline nlohmann::ordered_json list(const Eigen::MatrixXd& values) {
  return std::vector<double>(values.reshaped().begin(), values.reshaped().end());
}
/// Several of one kind, a list for each.
template <typename Several>
nlohmann::ordered_json lists(const Several& several) {
  nlohmann::ordered_json json = nlohmann::ordered_json::array();
  for (const auto& values : several) json.push_back(list(values));
  return json;
}

/// Read back, of `size` and of `size` x `size` numbers. Throws InputError that names the field where there are not as
/// many, or one is not finite.
inline Eigen::VectorXd vector_in(const nlohmann::ordered_json& json, Eigen::Index size, const char* field) {
  const auto values = json.get<std::vector<double>>();
  if (static_cast<Eigen::Index>(values.size()) != size)
    throw InputError(std::string("field '") + field + "' has not " + std::to_string(size) + " numbers");
  Eigen::VectorXd result = Eigen::VectorXd::Map(values.data(), size);
  if (!result.allFinite()) throw InputError(std::string("field '") + field + "' is not finite");
  return result;
}
inline Eigen::MatrixXd square_in(const nlohmann::ordered_json& json, Eigen::Index size, const char* field) {
  return vector_in(json, size * size, field).reshaped(size, size);
}

}  // namespace rangecal
