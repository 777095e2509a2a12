// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/plan/plan.hpp"

#include <fmt/format.h>

#include <memory>
#include <nlohmann/json.hpp>
#include <numbers>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::app {
namespace {

using Json = nlohmann::ordered_json;

Json to_json(const PlanDesign& d) {
  Json json{{"path", d.path},         {"places", d.places},         {"headings", d.headings},
            {"repeats", d.repeats},   {"minutes", d.minutes},       {"std_dev_m", d.std_dev_m},
            {"stops", Json::array()}, {"landmarks", Json::array()}, {"effects", Json::array()}};
  for (const Stop& stop : d.stops)
    json["stops"].push_back({{"stop", stop.label},
                             {"x_m", stop.commanded.x_m},
                             {"y_m", stop.commanded.y_m},
                             {"heading_rad", stop.commanded.heading_rad},
                             {"place", stop.place}});
  for (std::size_t l = 0; l < d.landmarks.size(); ++l)
    json["landmarks"].push_back({{"landmark", fmt::format("L{}", l)},
                                 {"x_m", d.landmarks[l].x()},
                                 {"y_m", d.landmarks[l].y()},
                                 {"radius_m", d.radius_m[l]}});
  for (const PlanEffect& e : d.effects)
    json["effects"].push_back(
        {{"effect", e.id}, {"seen", e.seen}, {"noncentrality", e.noncentrality}, {"harm_m", e.harm_m}});
  return json;
}

/// A text in YAML, which takes JSON's strings.
std::string quoted(const std::string& text) { return nlohmann::json(text).dump(); }

/// The design as a scene file: the sketch's sensor, the plan's stops and landmarks.
std::string scene_file(const PlanRequest& request, const PlanDesign& d) {
  const Scene& s = request.sketch;
  std::string text = "format: rangecal-scene/1\nsensor:\n  alpha: [";
  for (Eigen::Index i = 0; i < s.alpha.size(); ++i) text += fmt::format("{}{}", i ? ", " : "", s.alpha[i]);
  text +=
      fmt::format("]\n  noise: {{law: {}, sigma: {}}}\n  sigma_theta_rad: {}\n", to_string(s.noise.law),
                  s.noise.parameters[0], s.reads_bearings ? fmt::format("{}", s.sigma_theta_rad) : "none");
  if (!s.sensor.name.empty()) text += fmt::format("  name: {}\n", quoted(s.sensor.name));
  if (!s.sensor.principle.empty()) text += fmt::format("  principle: {}\n", quoted(s.sensor.principle));
  if (s.sensor.range_min_m > 0.0) text += fmt::format("  range_min_m: {}\n", s.sensor.range_min_m);
  if (std::isfinite(s.sensor.range_max_m)) text += fmt::format("  range_max_m: {}\n", s.sensor.range_max_m);
  text += fmt::format("stops:\n  sigma_xy_m: {}\n  sigma_heading_rad: {}\n  error: {}\n  list:\n",
                      s.sigma_xy_m, s.sigma_heading_rad,
                      s.stop_error == StopErrorModel::random_walk ? "random_walk" : "independent");
  for (const Stop& stop : d.stops)
    text += fmt::format("    - {{stop: \"{}\", x_m: {:.4f}, y_m: {:.4f}, heading_rad: {:.6f}{}}}\n",
                        stop.label, stop.commanded.x_m, stop.commanded.y_m, stop.commanded.heading_rad,
                        stop.place.empty() ? "" : ", place: " + stop.place);
  text += "landmarks:\n  list:\n";
  for (std::size_t l = 0; l < d.landmarks.size(); ++l)
    text += fmt::format("    - {{landmark: L{}, x_m: {:.4f}, y_m: {:.4f}, radius_m: {}}}\n", l,
                        d.landmarks[l].x(), d.landmarks[l].y(), d.radius_m[l]);
  text += fmt::format("repeats: {}\n", d.repeats);
  if (std::isfinite(s.visible_max_m))
    text += fmt::format("visibility: {{min_m: {}, max_m: {}}}\n", s.visible_min_m, s.visible_max_m);
  else if (s.visible_min_m > 0.0)
    text += fmt::format("visibility: {{min_m: {}}}\n", s.visible_min_m);
  return text;
}

std::string design_text(const char* title, const PlanDesign& d) {
  return fmt::format("{:<12} {}: {} places{}, {} landmarks, {} repeats; {:.1f} minutes, {:.2f} mm\n", title,
                     d.path, d.places, d.headings > 1 ? fmt::format(" x {} headings", d.headings) : "",
                     d.landmarks.size(), d.repeats, d.minutes, 1e3 * d.std_dev_m);
}

struct PlanCommand {
  PlanRequest request;
  std::string sketch, json, scene, line_scene;
  std::vector<double> range{0.5, 4.0};
  double accuracy_mm = 10.0;

  int run() {
    request.sketch = load_scene(sketch);
    request.accuracy_m = 1e-3 * accuracy_mm;
    request.low_m = range[0];
    request.high_m = range[1];
    require_writable({json, scene, line_scene});
    require_apart({json, scene, line_scene}, {sketch});
    const Plan plan = plan_experiment(request);
    if (!json.empty()) {
      Json file{{"format", "rangecal-plan/1"},
                {"outcome", to_string(plan.outcome)},
                {"reason", plan.reason},
                {"accuracy_m", request.accuracy_m},
                {"range_m", range},
                {"best", plan.best.places > 0 ? to_json(plan.best) : Json(nullptr)},
                {"line", plan.line ? to_json(*plan.line) : Json(nullptr)},
                {"evaluated", plan.evaluated}};
      write_file(json, file.dump(2) + "\n");
    }
    if (!scene.empty() && plan.best.places > 0) write_file(scene, scene_file(request, plan.best));
    if (!line_scene.empty() && plan.line) write_file(line_scene, scene_file(request, *plan.line));
    fmt::print("{}", page(plan));
    const bool no_line = !line_scene.empty() && !plan.line;
    if (no_line) fmt::print(stderr, "rangecal: {} is not written: there is no such line\n", line_scene);
    return plan.outcome == Outcome::converged && !no_line ? done : not_delivered;
  }

  std::string page(const Plan& plan) const {
    std::string text = fmt::format("Wanted       {:.2f} mm at most from {} to {} m, by the calibration{}\n",
                                   1e3 * request.accuracy_m, range[0], range[1],
                                   request.effects.empty() ? "" : ", effects allowed for");
    if (plan.outcome != Outcome::converged) text += "Outcome      " + plan.reason + "\n";
    if (plan.best.places == 0) return text;
    const PlanDesign& d = plan.best;
    text += design_text("Plan", d);
    if (plan.line)
      text += design_text("Line", *plan.line);
    else
      text += "Line         no straight line without turns, with landmarks at both sides, reaches that" +
              (plan.line_std_dev_m ? fmt::format(" (at best {:.2f} mm)\n", 1e3 * *plan.line_std_dev_m)
                                   : std::string("\n"));
    text += "\n  place      x [m]     y [m]   heading [deg]\n";
    for (const Stop& stop : d.stops)
      text += fmt::format("  {:<6} {:>9.2f} {:>9.2f} {:>12.0f}\n", stop.label, stop.commanded.x_m,
                          stop.commanded.y_m, stop.commanded.heading_rad * 180.0 / std::numbers::pi);
    text += "\n  landmark   x [m]     y [m]   radius [m]\n";
    for (std::size_t l = 0; l < d.landmarks.size(); ++l)
      text += fmt::format("  L{:<5} {:>9.2f} {:>9.2f} {:>12.3f}\n", l, d.landmarks[l].x(), d.landmarks[l].y(),
                          d.radius_m[l]);
    if (!d.effects.empty()) text += "\n  effect, typical size      shows    it costs unseen\n";
    for (const PlanEffect& effect : d.effects)
      text += fmt::format("  {:<24} {:>6} {:>12.1f} mm\n", effect.id, effect.seen ? "yes" : "no",
                          1e3 * effect.harm_m);
    return text;
  }
};

}  // namespace

void add_plan(CLI::App& app, Action& chosen) {
  CLI::App* command = app.add_subcommand(
      "plan", "propose stops, turns, landmarks and repeats that reach an accuracy soonest");
  const auto state = std::make_shared<PlanCommand>();
  command
      ->add_option(
          "SCENE.yaml", state->sketch,
          "sketch: the sensor as far as it is known, how far stops may be off, the room (the box of the random landmarks, or around what it has)")
      ->required();
  command
      ->add_option("--accuracy", state->accuracy_mm, "wanted standard deviation of a corrected distance [mm]")
      ->check(positive())
      ->capture_default_str();
  command->add_option("--range", state->range, "MIN MAX: distances at which it is wanted [m]")
      ->expected(2)
      ->capture_default_str();
  command
      ->add_option(
          "--effects", state->request.effects,
          "effects worried about ('rangecal effects' lists them): estimated along, and told whether they would show")
      ->delimiter(',');
  command->add_option("--radii", state->request.radii_m, "radii of the landmarks at hand, taken in turn [m]")
      ->delimiter(',')
      ->capture_default_str();
  command->add_option("--place-seconds", state->request.costs.place_s, "to drive to a place and settle")
      ->capture_default_str();
  command->add_option("--turn-seconds", state->request.costs.turn_s, "to turn the sensor on the spot")
      ->capture_default_str();
  command->add_option("--landmark-seconds", state->request.costs.landmark_s, "to put up a landmark")
      ->capture_default_str();
  command->add_option("--scan-seconds", state->request.costs.scan_s, "of one repeat, all landmarks at once")
      ->capture_default_str();
  command->add_option("-o,--output,--json", state->json, "write the plan to this file (JSON)");
  command->add_option("--scene", state->scene, "write the plan as a scene, for 'simulate' and 'study'");
  command->add_option("--line-scene", state->line_scene,
                      "write the papers' straight line of the same accuracy as a scene, where there is one");
  command->footer(
      "Tried are lines, diagonals, two legs and loops through the room, one, two or four headings at each place, three to six landmarks, each\n"
      "moved about the room, and all numbers of places and repeats. The accuracy is that of the Cramer-Rao bound, with the\n"
      "effects as further unknowns. For comparison: the cheapest straight line with five landmarks at both sides.\n"
      "Exit code 1 where nothing reaches the accuracy; the most accurate plan is given then.\n"
      "\n"
      "Example:\n"
      "  rangecal plan notebooks_data/scenes/field-layout.yaml --accuracy 8 --effects tilt,lever_arm --scene plan.yaml\n"
      "  rangecal simulate plan.yaml -o rehearsal && rangecal calibrate rehearsal");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
