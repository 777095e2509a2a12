// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <charconv>
#include <cmath>
#include <functional>
#include <map>
#include <numbers>

#include "rangecal/core/errors.hpp"
#include "rangecal/problems/world/scene_size.hpp"
#include "rangecal/solvers/study/study.hpp"

namespace rangecal {
namespace {

double number(const std::string& text) {
  double value = 0.0;
  const auto [end, error] = std::from_chars(text.data(), text.data() + text.size(), value);
  if (error != std::errc() || end != text.data() + text.size() || !std::isfinite(value))
    throw InputError(fmt::format("'{}' is not a number", text.substr(0, 40)));
  return value;
}

double not_negative(const std::string& text) {
  const double value = number(text);
  if (value < 0.0) throw InputError(fmt::format("'{}' is negative", text));
  return value;
}

double positive(const std::string& text) {
  const double value = number(text);
  if (!(value > 0.0)) throw InputError(fmt::format("'{}' is not positive", text));
  return value;
}

int whole(const std::string& text, int at_least) {
  const double value = number(text);
  if (value != std::floor(value) || value < at_least || value > 1e8)
    throw InputError(fmt::format("'{}' is not a whole number of at least {}", text, at_least));
  return static_cast<int>(value);
}

void need(const Scene& scene, RecordingKind kind) {
  if (scene.kind != kind)
    throw InputError(
        fmt::format("belongs to a scene of kind {}", kind == RecordingKind::pairs ? "pairs" : "landmarks"));
}

void set_sigma_s(Scene& scene, const std::string& value) {
  need(scene, RecordingKind::landmarks);
  scene.sigma_xy_m = not_negative(value);
  for (Stop& stop : scene.stops) stop.sigma_xy_m.reset();
}

void set_landmarks(Scene& scene, const std::string& value) {
  need(scene, RecordingKind::landmarks);
  const int count = whole(value, 1), listed = static_cast<int>(scene.landmarks.size());
  if (scene.random_landmarks) {
    if (count < listed + 1)
      throw InputError(
          fmt::format("{} landmarks, of which {} are listed and one is random at least", count, listed));
    scene.random_landmarks->count = count - listed;
    return;
  }
  if (count > listed) throw InputError(fmt::format("{} landmarks, but the scene lists {}", count, listed));
  scene.landmarks.resize(count);
  scene.positions.resize(count);
  const auto gone = [&](const SceneTape& tape) { return std::max(tape.from, tape.to) >= count; };
  scene.tapes.erase(std::remove_if(scene.tapes.begin(), scene.tapes.end(), gone), scene.tapes.end());
}

/// f = d + c (f0 - d): c = 0 is a sensor without bias, c = 1 the scene's own.
void set_bias_scale(Scene& scene, const std::string& value) {
  const double c = number(value);
  if (scene.alpha.size() < 2) throw InputError("needs an alpha of order 1 at least");
  scene.alpha *= c;
  scene.alpha[1] += 1.0 - c;
}

void set_readings(Scene& scene, const std::string& value) {
  scene.repeats = whole(value, 1);
  for (SceneBatch& batch : scene.batches) batch.readings = scene.repeats;
}

/// The power law's sigma; for the polynomial law beta = value * alpha, the 2021 paper's way to state it.
void set_noise_sigma(Scene& scene, const std::string& value) {
  if (!has_sigma(scene.noise.law))
    scene.noise.parameters = positive(value) * scene.alpha;
  else
    scene.noise.parameters = Eigen::VectorXd::Constant(1, positive(value));
}

void set_noise_law(Scene& scene, const std::string& value) {
  const NoiseLaw law = noise_law_from_string(value);
  if (has_sigma(law) != has_sigma(scene.noise.law))
    throw InputError("the polynomial law has other parameters than the power laws");
  scene.noise.law = law;
}

using Setter = std::function<void(Scene&, const std::string&)>;

const std::map<std::string, Setter>& setters() {
  static const std::map<std::string, Setter> all = {
      {"sigma_s_m", set_sigma_s},
      {"sigma_theta_rad",
       [](Scene& s, const std::string& v) {
         need(s, RecordingKind::landmarks);
         s.sigma_theta_rad = not_negative(v);
       }},
      {"sigma_theta_deg",
       [](Scene& s, const std::string& v) {
         need(s, RecordingKind::landmarks);
         s.sigma_theta_rad = not_negative(v) * std::numbers::pi / 180.0;
       }},
      {"sigma_heading_rad",
       [](Scene& s, const std::string& v) {
         need(s, RecordingKind::landmarks);
         s.sigma_heading_rad = not_negative(v);
         for (Stop& stop : s.stops) stop.sigma_heading_rad.reset();
       }},
      {"landmarks", set_landmarks},
      {"stops",
       [](Scene& s, const std::string& v) {
         need(s, RecordingKind::landmarks);
         const int count = whole(v, 2);
         if (count > most_scene_stops)
           throw InputError(fmt::format("{} stops are more than a million", count));
         s = with_stops(std::move(s), count);
       }},
      {"readings", set_readings},
      {"noise_sigma", set_noise_sigma},
      {"noise_law", set_noise_law},
      {"bias_scale", set_bias_scale}};
  return all;
}

}  // namespace

Scene with_stops(Scene scene, int count) {
  const Pose2 first = scene.stops.front().commanded, last = scene.stops.back().commanded;
  scene.stops.assign(count, scene.stops.front());
  for (int k = 0; k < count; ++k) {
    const double share = static_cast<double>(k) / (count - 1);
    scene.stops[k].label = std::to_string(k);
    scene.stops[k].commanded.x_m = first.x_m + share * (last.x_m - first.x_m);
    scene.stops[k].commanded.y_m = first.y_m + share * (last.y_m - first.y_m);
  }
  return scene;
}

Scene with_parameter(Scene scene, const std::string& parameter, const std::string& value) {
  const auto setter = setters().find(parameter);
  if (setter == setters().end()) {
    std::string known = "scene, fit_order";
    for (const auto& [name, set] : setters()) known += ", " + name;
    throw InputError(fmt::format("'{}' is not a parameter; known: {}", parameter.substr(0, 40), known));
  }
  setter->second(scene, value);
  check_size(scene);
  return scene;
}

}  // namespace rangecal
