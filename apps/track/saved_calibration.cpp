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

using Json = nlohmann::ordered_json;

Json json_of(const Calibration& c) {
  Json json{{"alpha", std::vector<double>(c.alpha.begin(), c.alpha.end())},
            {"covariance", std::vector<double>(c.alpha_covariance->reshaped().begin(),
                                               c.alpha_covariance->reshaped().end())},
            {"law", to_string(c.noise.law)},
            {"noise", std::vector<double>(c.noise.parameters.begin(), c.noise.parameters.end())},
            {"range_m", {c.range_min_m, c.range_max_m}}};
  for (const auto& [channel, shape] : c.noise_shapes)
    json["noise_shapes"][channel] = {{"family", shape.family}, {"parameters", shape.parameters}};
  return json;
}

Calibration calibration_in(const Json& json) {
  Calibration c;
  const auto alpha = json.at("alpha").get<std::vector<double>>(),
             covariance = json.at("covariance").get<std::vector<double>>();
  const auto size = static_cast<Eigen::Index>(alpha.size());
  if (size == 0 || covariance.size() != alpha.size() * alpha.size())
    throw InputError("the state's calibration is not whole");
  // states of 0.1.0 have one sigma
  const auto noise = json.contains("noise") ? json.at("noise").get<std::vector<double>>()
                                            : std::vector<double>{json.at("sigma").get<double>()};
  const NoiseLaw law = noise_law_from_string(json.at("law").get<std::string>());
  if (noise.empty() || (has_sigma(law) && !(noise.size() == 1 && noise[0] > 0.0)))
    throw InputError("the state's sigma is not positive");
  c.outcome = Outcome::converged;
  c.kind = RecordingKind::pairs;
  c.alpha = Eigen::VectorXd::Map(alpha.data(), size);
  c.alpha_covariance = Eigen::MatrixXd::Map(covariance.data(), size, size);
  c.noise = {law, Eigen::VectorXd::Map(noise.data(), static_cast<Eigen::Index>(noise.size()))};
  c.range_min_m = json.at("range_m").at(0);
  c.range_max_m = json.at("range_m").at(1);
  if (json.contains("noise_shapes"))
    for (const auto& [channel, shape] : json.at("noise_shapes").items())
      c.noise_shapes[channel] = {
          shape.at("family"), shape.at("parameters").get<std::map<std::string, double>>(), {}};
  noise_shape_of(c, "range");  // throws for a family that is none
  return c;
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
