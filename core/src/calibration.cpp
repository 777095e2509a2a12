// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/calibration.hpp"

#include <array>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/names.hpp"
#include "rangecal/core/polynomial.hpp"

namespace rangecal {

namespace {

constexpr auto method_names = names_of<Method>("method", {{Method::closed_form, "closed-form"},
                                                          {Method::approximate, "approximate"},
                                                          {Method::full, "full"},
                                                          {Method::marginal, "marginal"}});

}  // namespace

std::span<const Method> all_methods() {
  static constexpr std::array all = method_names.values();
  return all;
}

const char* to_string(Method method) { return method_names.name_of(method); }

Method method_from_string(const std::string& text) { return method_names.value_of(text); }

std::vector<std::string> labels_of_landmarks(const Calibration& calibration) {
  std::vector<std::string> labels = calibration.labels;
  for (const LandmarkEstimate& landmark : calibration.landmarks) labels.push_back(landmark.label);
  return labels;
}

const std::optional<Eigen::MatrixXd>& curve_covariance(const Calibration& calibration) {
  return calibration.covariance_with_choice ? calibration.covariance_with_choice
                                            : calibration.alpha_covariance;
}

double shape_variance(const Calibration& calibration, double distance_m) {
  if (!calibration.scale.spline) return 0.0;
  const double by_u = evaluate_derivative(calibration.alpha, calibration.scale.of(distance_m));
  return by_u * by_u * calibration.scale.spline->variance(distance_m);
}

std::optional<double> curve_variance(const Calibration& calibration, double distance_m) {
  const std::optional<Eigen::MatrixXd>& covariance = curve_covariance(calibration);
  if (!covariance) return std::nullopt;
  return evaluate_form(*covariance, calibration.scale.of(distance_m)) +
         shape_variance(calibration, distance_m);
}

double Calibration::f(double d) const { return evaluate_polynomial(alpha, scale.of(d)); }

double Calibration::slope(double d) const { return evaluate_derivative(alpha, scale.of(d)) * scale.slope(d); }

void require_polynomial(const Calibration& calibration, const std::string& user) {
  if (!calibration.scale.is_distance())
    throw InputError(user + ": the calibration's curve is a " + to_string(calibration.scale.family) +
                     ", and a polynomial in the distance is needed");
}

}  // namespace rangecal
