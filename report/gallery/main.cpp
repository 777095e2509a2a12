// SPDX-License-Identifier: BSD-3-Clause
// rangecal_gallery FOLDER [EFFECT...]: for every effect of the catalogue one recording that holds it,
// diagnosed with the effect left out; what its residuals then look like goes to FOLDER/EFFECT.json, as
// charts. docs/make_gallery.mjs draws them. The same program makes the same files.
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <exception>
#include <optional>
#include <tuple>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/random.hpp"
#include "rangecal/problems/effects/effect.hpp"
#include "rangecal/problems/world/physical/designs.hpp"
#include "rangecal/problems/world/physical/plants.hpp"
#include "rangecal/problems/world/physical/simulate.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "residuals.hpp"

namespace {

using namespace rangecal;
using report::Json;

/// A recording with an effect in it, and what was planted in words.
struct Specimen {
  Recording recording;
  std::string planted;
  Diagnosis diagnosis;
};
double gain_of(const Diagnosis& diagnosis) { return diagnosis.before.nll - diagnosis.after.nll; }

Diagnosis with_effect_named(const Recording& recording, const std::string& id) {
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  options.null_draws = 100;
  options.force = std::vector<std::string>{id};
  return diagnose({&recording, 1}, options);
}

const world::EffectInfo* plant_of(const std::string& id) {
  const auto& table = world::effect_table();
  const auto found =
      std::find_if(table.begin(), table.end(), [&](const world::EffectInfo& e) { return e.id == id; });
  return found == table.end() ? nullptr : &*found;
}

/// The physical world with the effect in it: of both designs the one where it shows more, as large as it
/// takes to show (half of what is plausible at most).
std::optional<Specimen> planted_specimen(const std::string& id) {
  const world::EffectInfo* plant = plant_of(id);
  if (!plant) return std::nullopt;
  std::optional<Specimen> best;
  constexpr double clear = 60.0;  // nats
  for (const double factor : {1.0, 2.0, 4.0}) {
    const double size = std::min(factor * plant->typical, 0.5 * (plant->typical + plant->maximum));
    for (const bool turning : {false, true}) {
      Random random(seed_from("gallery " + id));
      world::World w =
          world::vary(turning ? world::make_turning_design() : world::make_line_design(), random);
      w = world::apply(w, id, size, random);
      const Recording recording = world::simulate(w, seed_from("gallery run " + id));
      const Diagnosis diagnosis = with_effect_named(recording, id);
      if (best && gain_of(diagnosis) <= gain_of(best->diagnosis)) continue;
      best = Specimen{recording,
                      fmt::format("{:g}{}, {}", size, plant->unit == "1" ? "" : " " + plant->unit,
                                  turning ? "a loop with turns" : "a straight line"),
                      diagnosis};
    }
    if (gain_of(best->diagnosis) > clear) break;
  }
  return best;
}

/// The readings within 1 rad of the middle of the sensor's view.
Recording looking_one_way(Recording recording) {
  Readings kept;
  const Readings& all = recording.readings;
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (std::abs(all.bearing_rad[i]) > 1.0) continue;
    kept.stop.push_back(all.stop[i]);
    kept.landmark.push_back(all.landmark[i]);
    kept.repeat.push_back(all.repeat[i]);
    if (!all.time_s.empty()) kept.time_s.push_back(all.time_s[i]);
    kept.range_m.push_back(all.range_m[i]);
    kept.bearing_rad.push_back(all.bearing_rad[i]);
    kept.row.push_back(all.row[i]);
  }
  recording.readings = kept;
  return recording;
}

/// What a sensor sees that looks one way: landmarks in front of a line of stops.
const char* const one_way_scene = R"(
format: rangecal-scene/1
sensor: {alpha: [0.0525, 0.8838, 0.0584], noise: {law: f2, sigma: 0.003}, sigma_theta_rad: 0.005, range_min_m: 0.1, range_max_m: 10.0}
stops: {line: {count: 20, step_m: 0.15}, sigma_xy_m: 0.01}
landmarks:
  radius_m: 0.05
  list:
    - {landmark: A, x_m: 1.8, y_m: 0.9}
    - {landmark: B, x_m: 2.4, y_m: -1.3}
    - {landmark: C, x_m: 3.1, y_m: 1.8}
    - {landmark: D, x_m: 3.6, y_m: -0.7}
    - {landmark: E, x_m: 4.0, y_m: 0.4}
    - {landmark: F, x_m: 4.4, y_m: -2.2}
repeats: 10
)";

/// A robot that reads while it winds its way between landmarks on all sides.
std::string driven_scene() {
  std::string text =
      "format: rangecal-scene/1\n"
      "sensor: {alpha: [0.0525, 0.8838, 0.0584], noise: {law: f2, sigma: 0.003}, sigma_theta_rad: 0.005}\n"
      "timing: {drive_s: 0.48, sweep_s: 0.01}\nrepeats: 3\nlandmarks:\n  list:\n";
  for (const auto& [label, x, y] :
       {std::tuple("A", 0.5, 1.2), {"B", 1.2, -1.0}, {"C", 2.5, 1.5}, {"D", 3.4, -0.9}, {"E", 4.6, 0.8}})
    text += fmt::format("    - {{landmark: {}, x_m: {}, y_m: {}}}\n", label, x, y);
  text += "stops:\n  sigma_xy_m: 0.005\n  list:\n";
  double x = 0.0, y = 0.0;
  for (int k = 0; k < 40; ++k) {
    const double heading = 1.2 * std::sin(0.4 * k);
    text += fmt::format("    - {{x_m: {:.4f}, y_m: {:.4f}, heading_rad: {:.4f}}}\n", x, y, heading);
    x += 0.15 * std::cos(heading + 0.2 * std::cos(0.4 * k)),
        y += 0.15 * std::sin(heading + 0.2 * std::cos(0.4 * k));
  }
  return text;
}

/// For an effect that the physical world cannot plant: one of these scenes, simulated again with the effect at its typical size.
Specimen modelled_specimen(const Effect& effect) {
  const EffectInfo& info = effect.info();
  const bool driven = effect.acts_on_stops() && info.kind == EffectKind::mean;
  const Scene scene = parse_scene(driven ? driven_scene() : one_way_scene, "the scene");
  Recording recording = simulate(scene, seed_from("gallery run " + info.id));
  if (!driven) recording = looking_one_way(recording);
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  SimulationModel model = diagnose({&recording, 1}, options).simulation;
  std::string planted;
  for (const EffectParameter& p : info.parameters) {
    model.calibration.effects[info.id][p.name] = p.typical;
    planted += fmt::format("{}{} {:g}", planted.empty() ? "" : ", ", p.name, p.typical);
  }
  const Recording again = simulate(model, seed_from("gallery again " + info.id)).front();
  return {again, planted + (driven ? ", a path with turns" : ", a sensor that looks one way"),
          with_effect_named(again, info.id)};
}

/// The column along which a picture of the effect is drawn; "" for effects along none.
std::string column_for(const Effect& effect) {
  constexpr std::pair<ColumnRole, const char*> columns[] = {{ColumnRole::temperature, "temperature_c"},
                                                            {ColumnRole::received_power, "rx_power_dbm"},
                                                            {ColumnRole::azimuth, "azimuth_deg"},
                                                            {ColumnRole::other, "humidity_percent"}};
  for (const auto& [role, name] : columns)
    if (effect.lies_along(role)) return name;
  return "";
}

/// For an effect of recorded columns, of devices or of long distances: 400 readings at known distances by three devices, with the
/// effect at twice its typical size.
Specimen table_specimen(const Effect& effect) {
  const EffectInfo& info = effect.info();
  Random random(seed_from("gallery table " + info.id));
  Recording recording;
  recording.kind = RecordingKind::pairs;
  recording.landmarks = {{"A", 0.0, {}}, {"B", 0.0, {}}, {"C", 0.0, {}}};
  Pairs& pairs = recording.pairs;
  const std::string column = column_for(effect);
  const double far = info.id == "range_saturation" ? 60.0 : 6.0, noise = 0.002 * 36.0 / (far * far);
  for (int i = 0; i < 400; ++i) {
    const double d = random.uniform(0.3, far), f = 0.02 + d * (1.01 + 0.002 * d);
    pairs.true_m.push_back(d);
    pairs.reading_m.push_back(random.normal(f, noise * f * f));
    pairs.landmark.push_back(i % 3);
    pairs.row.push_back(i + 2);
    const double half = effect.info().id.starts_with("antenna_pattern") ? 180.0 : 15.0,
                 middle = half < 90.0 ? 25.0 : 0.0;
    if (!column.empty()) pairs.covariates[column].push_back(random.uniform(middle - half, middle + half));
  }
  DiagnoseOptions options;
  options.held_out = options.unseen = options.next_experiments = false;
  SimulationModel model = diagnose({&recording, 1}, options).simulation;
  std::string planted;
  EffectContext context;
  context.range_max_m = far;
  context.covariates = {column};
  context.columns = {{ColumnRole::other, 25.0, 8.7}};
  const Eigen::VectorXd start = effect.start_grid(context).front();
  for (std::size_t j = 0; j < info.parameters.size(); ++j) {
    const EffectParameter& p = info.parameters[j];
    model.calibration.effects[info.id][p.name] =
        p.linear ? 2.0 * p.typical : start[static_cast<Eigen::Index>(j)];
    if (p.linear && planted.empty()) planted = fmt::format("{} {:g}", p.name, 2.0 * p.typical);
  }
  const Recording again = simulate(model, seed_from("gallery again " + info.id)).front();
  return {again, planted + ", 400 readings at known distances", with_effect_named(again, info.id)};
}

Specimen specimen_of(const Effect& effect) {
  const std::string& id = effect.info().id;
  if (!column_in_id(id).empty() || id == "device_offset" || id == "range_saturation")
    return table_specimen(effect);
  std::optional<Specimen> planted = planted_specimen(id);
  return planted ? *planted : modelled_specimen(effect);
}

Json entry_of(const Effect& kind) {
  const std::string column = column_for(kind);
  const Effect& effect = column.empty() ? kind : *find_effect(kind.info().id + ":" + column);
  const EffectInfo& info = effect.info();
  std::optional<Specimen> specimen = specimen_of(effect);
  Diagnosis& d = specimen->diagnosis;
  std::vector<Finding> own;  // the effect's own place alone
  for (const Finding& f : d.location)
    if (own.empty() && f.channel == info.channel && f.covariate == info.covariate) own.push_back(f);
  d.location = own;
  report::Page page(info.id, "");
  const report::FitView recorded = report::view_of({specimen->recording}, d.baseline);
  Recording read = specimen->recording;
  if (!d.simulation.landmark_read.empty()) read.readings.landmark = d.simulation.landmark_read.front();
  const report::FitView before = report::view_of({read}, d.baseline, report::covariates_of(d));
  report::add_findings(page, d, recorded, before, nullptr, 1);
  Json entry{
      {"id", kind.info().id},          {"physics", kind.info().physics}, {"formula", info.formula},
      {"channel", info.channel},       {"covariate", info.covariate},    {"visible_by", info.visible_by},
      {"settled_by", info.settled_by}, {"planted", specimen->planted},   {"gain", std::round(gain_of(d))}};
  entry["page"] = page.data();
  return entry;
}

int run(int argc, char** argv) {
  if (argc < 2 || argv[1][0] == '-') throw InputError("usage: rangecal_gallery FOLDER [EFFECT...]");
  const std::string folder = argv[1];
  make_folder(folder);
  for (const auto& effect : effect_registry()) {
    const std::string& id = effect->info().id;
    if (argc > 2 && std::none_of(argv + 2, argv + argc, [&](const char* wanted) { return id == wanted; }))
      continue;
    write_file(folder + "/" + id + ".json", entry_of(*effect).dump() + "\n");
  }
  return 0;
}

}  // namespace

int main(int argc, char** argv) {
  try {
    return run(argc, argv);
  } catch (const std::exception& error) {
    fmt::print(stderr, "rangecal_gallery: {}\n", error.what());
    return 2;
  }
}
