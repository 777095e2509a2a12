// SPDX-License-Identifier: BSD-3-Clause
// Effects of a scene: which there are, that they can act there, and what their parameters are.
#include <fmt/format.h>

#include <algorithm>
#include <cmath>
#include <functional>
#include <numbers>
#include <utility>

#include "rangecal/core/angles.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/world/scene_recording.hpp"
#include "scene_parts.hpp"

namespace rangecal {
namespace {

using Given = std::map<std::string, double>;
/// Throws: what is wrong with a parameter, or with the effect where that is empty.
using Fault = std::function<void(const std::string& parameter, const std::string& what)>;

/// Largest |direction| in the sensor's frame at which a landmark, or a corner of the random ones' box, lies from a stop; or
/// the first one sideways or behind, which no sensor that looks one way sees.
double largest_bearing(const Scene& scene) {
  constexpr double sideways = 0.5 * std::numbers::pi;
  std::vector<Eigen::Vector2d> places = scene.positions;
  if (const auto& random = scene.random_landmarks)
    for (const double x : {random->box_min_m.x(), random->box_max_m.x()})
      for (const double y : {random->box_min_m.y(), random->box_max_m.y()}) places.emplace_back(x, y);
  double largest = 0.0;
  for (const Stop& stop : scene.stops) {
    const Pose2& pose = stop.commanded;
    for (const Eigen::Vector2d& place : places) {
      const double direction = std::atan2(place.y() - pose.y_m, place.x() - pose.x_m);
      largest = std::max(largest, std::abs(wrap_angle(direction - pose.heading_rad)));
      if (largest > sideways) return largest;
    }
  }
  return largest;
}

/// What the readings of the scene will have in common, as far as an effect asks for it.
EffectContext context_of(const Scene& scene) {
  EffectContext context;
  context.kind = scene.kind;
  const std::vector<double> starts = start_times_s(scene);
  if (!starts.empty()) {
    const bool pairs = scene.kind == RecordingKind::pairs;
    const int last = pairs ? scene.batches.back().readings : scene.repeats;
    context.stay_s = (last - 1) * scene.timing->sweep_s;
    context.duration_s = starts.back() + context.stay_s;
  }
  if (scene.kind == RecordingKind::pairs) return context;
  context.stop_time_s = starts;
  context.stop_count = static_cast<int>(scene.stops.size());
  for (const Stop& stop : scene.stops) context.commanded.push_back(stop.commanded);
  for (const Landmark& landmark : scene.landmarks) context.landmark_radius_m.push_back(landmark.radius_m);
  if (const auto& random = scene.random_landmarks)
    context.landmark_radius_m.insert(context.landmark_radius_m.end(), static_cast<std::size_t>(random->count),
                                     random->radius_m);
  context.landmark_count = static_cast<int>(context.landmark_radius_m.size());
  context.largest_cell = scene.repeats;
  context.largest_bearing_rad = largest_bearing(scene);
  context.reads_bearings = scene.reads_bearings;
  return context;
}

/// What a parameter counts: landmarks, stops, forms of the effect; empty for one that measures.
struct Choice {
  std::string of;
  int count = 0;
};

Choice choice_of(const EffectContext& context, const EffectParameter& parameter) {
  const std::string& name = parameter.name;
  if (name == "landmark" || name == "first" || name == "second") return {"landmark", context.landmark_count};
  if (name == "stop" || name == "from_stop" || name == "to_stop") return {"stop", context.stop_count};
  if (name == "power" || name == "form") return {name, static_cast<int>(parameter.high) + 1};
  return {};
}

void check_value(const EffectContext& context, const EffectParameter& parameter, double value,
                 const Fault& fault) {
  const Choice choice = choice_of(context, parameter);
  if (choice.of.empty()) {
    if (!(value >= parameter.low && value <= parameter.high))
      fault(parameter.name, fmt::format("{} is outside {:g} to {:g}", value, parameter.low, parameter.high));
  } else if (!(value >= 0.0 && value < choice.count && value == std::floor(value))) {
    fault(parameter.name,
          fmt::format("{} is no {}: 0 to {}, in the scene's order", value, choice.of, choice.count - 1));
  }
}

/// A size that may be 0: of a grid, a spread, a correlation. Not what it takes to be there at all, a period, say.
bool is_size(const EffectParameter& parameter) {
  return !parameter.linear && !parameter.discrete && parameter.low <= 0.0;
}

Given completed(const EffectContext& context, const EffectInfo& info, const Given& given,
                const Fault& fault) {
  std::string known;
  for (const EffectParameter& parameter : info.parameters)
    known += (known.empty() ? "" : ", ") + parameter.name;
  for (const auto& [name, value] : given)
    if (std::none_of(info.parameters.begin(), info.parameters.end(),
                     [&name = name](const EffectParameter& p) { return p.name == name; }))
      fault(name,
            "the effect " + info.id + " has no parameter '" + name.substr(0, 40) + "'; known here: " + known);
  const bool sized =
      std::any_of(info.parameters.begin(), info.parameters.end(),
                  [&](const EffectParameter& p) { return is_size(p) && given.count(p.name) > 0; });
  Given values;
  for (const EffectParameter& parameter : info.parameters) {
    const auto found = given.find(parameter.name);
    double& value = values[parameter.name];
    if (found != given.end()) {
      check_value(context, parameter, value = found->second, fault);
    } else if (!parameter.linear && !(sized && is_size(parameter))) {
      const Choice choice = choice_of(context, parameter);
      value = choice.of.empty() ? parameter.typical : std::min(parameter.typical, choice.count - 1.0);
    }
  }
  return values;
}

/// True if what the effect does to a reading changes with what `move` changes.
template <typename Move>
bool depends(const Effect& effect, const Given& values, const Move& move) {
  const auto& parameters = effect.info().parameters;
  Eigen::VectorXd p(static_cast<Eigen::Index>(parameters.size()));
  for (Eigen::Index j = 0; j < p.size(); ++j) p[j] = values.at(parameters[static_cast<std::size_t>(j)].name);
  ReadingView<double> at;
  at.bearing = 0.3, at.radius = 0.05, at.slope = 1.0, at.curvature = 0.0, at.spread = 0.01;
  if (const auto landmark = values.find("landmark"); landmark != values.end())
    at.landmark = static_cast<int>(landmark->second);
  for (const double d : {0.3, 1.0, 3.0}) {
    ReadingView<double> moved = at;
    moved.d = moved.f = d, moved.axis_distance = d + at.radius;
    const auto change = [&] {
      const ReadingChange<double> c = effect.reading(moved, p.data());
      return std::pair(c.range, c.range_log_variance);
    };
    const auto before = change();
    for (const double to : {1.1, -2.0, 2.9}) {
      move(moved, to);
      if (change() != before) return true;
    }
  }
  return false;
}

/// What the scene lacks for any size of the effect; empty if nothing.
std::string lacks(const EffectContext& context, const Effect& effect) {
  const std::string missing = effect.lacking(context);
  return missing.find("time_s") == std::string::npos ? missing : missing + ", which `timing` gives";
}

/// What it lacks for this effect as it is.
std::string lacks(const EffectContext& context, const Effect& effect, const Given& values) {
  if (context.kind == RecordingKind::pairs &&
      depends(effect, values, [](auto& at, double bearing) { at.bearing = bearing; }))
    return "directions: a column bearing_rad, which the pairs of a scene do not have";
  const auto& radii = context.landmark_radius_m;
  const bool round = std::any_of(radii.begin(), radii.end(), [](double radius) { return radius > 0.0; });
  if (!round && depends(effect, values, [](auto& at, double to) { at.radius = 0.01 * std::abs(to); }))
    return "radii: landmarks with a radius_m";
  return {};
}

void check_labels(const Given& values, const Fault& fault) {
  if (values.at("first") == values.at("second")) fault("", "first and second are one landmark: name two");
  if (values.at("from_stop") > values.at("to_stop")) fault("", "from_stop lies behind to_stop");
}

Given checked(const Scene& scene, const EffectContext& context, const std::string& id, const Given& given,
              const Fault& fault) {
  const Effect* effect = find_effect(id);
  if (!effect) {
    fault("", "no effect is called '" + id.substr(0, 40) + "'; `rangecal effects` lists them");
    return {};
  }
  if (scene.optics) fault("", "acts on a polynomial sensor only");
  if (const std::string missing = lacks(context, *effect); !missing.empty())
    fault("", "the scene lacks " + missing);
  const bool scale = id == "range_scale";  // its other form grows with the temperature
  if (const auto form = given.find("form"); scale && form != given.end() && form->second != 0.0)
    fault("form", "any form but 0 takes a column temperature_c, which a scene does not have");
  Given values = completed(context, effect->info(), given, fault);
  if (scale) values["form"] = 0.0;
  if (id == "label_swap") check_labels(values, fault);
  if (const std::string missing = lacks(context, *effect, values); !missing.empty())
    fault("", "the scene lacks " + missing);
  return values;
}

}  // namespace

Given scene_effect(const Scene& scene, const std::string& id, const Given& given) {
  return checked(
      scene, context_of(scene), id, given, [&](const std::string& parameter, const std::string& what) {
        throw InputError(parameter.empty() ? id + ": " + what : id + "." + parameter + ": " + what);
      });
}

void scene_parts::read_effects(const YamlReader& node, Scene& scene) {
  const EffectContext context = context_of(scene);
  for (const auto& [id, effect] : node.entries()) {
    Given given;
    std::map<std::string, YamlReader> nodes;
    const Fault fault = [&, &effect = effect](const std::string& parameter, const std::string& what) {
      const auto found = nodes.find(parameter);
      (found == nodes.end() ? effect : found->second).fail(what);
    };
    if (!find_effect(id)) checked(scene, context, id, given, fault);
    for (const auto& [name, value] : effect.entries()) {
      nodes.emplace(name, value);
      given[name] = value.number();
    }
    scene.effects[id] = checked(scene, context, id, given, fault);
  }
}

}  // namespace rangecal
