// SPDX-License-Identifier: BSD-3-Clause
#include "track/saved_calibration.hpp"

#include <fmt/format.h>

#include <array>
#include <map>
#include <string>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/noise_shape.hpp"

namespace rangecal::app {

namespace {

struct SavedShape {
  std::string family;
  std::map<std::string, double> parameters;
};

void fields(JsonFields& json, SavedShape& shape) {
  json.required("family", shape.family);
  json.required("parameters", shape.parameters);
}

}  // namespace

void fields(JsonFields& json, SavedCalibration& saved) {
  Calibration& c = saved.calibration;
  Eigen::MatrixXd covariance = c.alpha_covariance.value_or(Eigen::MatrixXd());
  std::map<std::string, SavedShape> shapes;
  for (const auto& [channel, shape] : c.noise_shapes) shapes[channel] = {shape.family, shape.parameters};
  json.numbers("alpha", c.alpha);
  json.check(c.alpha.size() > 0, "alpha", "is empty");
  json.numbers("covariance", covariance, c.alpha.size(), c.alpha.size());
  json.word("law", c.noise.law, noise_law_from_string);
  if (json.has("sigma")) {  // states of 0.1.0 have one sigma
    c.noise.parameters.resize(1);
    json.required("sigma", c.noise.parameters[0]);
  } else {
    json.numbers("noise", c.noise.parameters);
  }
  const Eigen::VectorXd& noise = c.noise.parameters;
  json.check(noise.size() > 0 && (!has_sigma(c.noise.law) || (noise.size() == 1 && noise[0] > 0.0)), "noise",
             "is not one positive sigma");
  json.required("range_m", std::tie(c.range_min_m, c.range_max_m));
  json.if_any("noise_shapes", shapes);
  if (json.writing()) return;
  c.outcome = Outcome::converged;
  c.kind = RecordingKind::pairs;
  c.alpha_covariance = covariance;
  for (const auto& [channel, shape] : shapes) c.noise_shapes[channel] = {shape.family, shape.parameters, {}};
  noise_shape_of(c, "range");  // throws for a family that is none
}

std::string fingerprint_of(const Calibration& c) {
  std::string text = to_string(c.noise.law);
  const auto add = [&](const auto& values) {
    for (const double value : values) text += fmt::format(" {}", value);
  };
  add(c.alpha);
  add(c.noise.parameters);
  add(std::array{c.range_min_m, c.range_max_m});
  if (c.alpha_covariance) add(c.alpha_covariance->reshaped());
  if (c.sigma_theta_rad) add(std::array{c.sigma_theta_rad->value});
  for (const auto& [channel, shape] : c.noise_shapes) {
    text += " " + channel + " " + shape.family;
    for (const auto& [name, value] : shape.parameters) text += fmt::format(" {}", value);
  }
  return fmt::format("{:016x}", seed_from(text));
}

}  // namespace rangecal::app
