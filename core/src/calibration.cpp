// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration.hpp"

#include <array>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {

std::span<const Method> all_methods() {
  static constexpr std::array all{Method::closed_form, Method::approximate, Method::full, Method::marginal};
  return all;
}

const char* to_string(Method method) {
  switch (method) {
    case Method::closed_form:
      return "closed-form";
    case Method::approximate:
      return "approximate";
    case Method::full:
      return "full";
    case Method::marginal:
      return "marginal";
  }
  return "";
}

Method method_from_string(const std::string& text) {
  std::string accepted;
  for (const Method method : all_methods()) {
    if (text == to_string(method)) return method;
    accepted += (accepted.empty() ? "" : ", ") + std::string(to_string(method));
  }
  throw InputError("method is '" + text + "', not one of " + accepted);
}

std::optional<double> curve_variance(const Calibration& calibration, double distance_m) {
  const auto& covariance =
      calibration.covariance_with_choice ? calibration.covariance_with_choice : calibration.alpha_covariance;
  if (!covariance) return std::nullopt;
  return evaluate_form(*covariance, distance_m);
}

}  // namespace rangecal
