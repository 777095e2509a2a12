// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/scene_simulation.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "text.hpp"

namespace rangecal::app {

namespace {

/// Why the scene shows no landmark from any stop.
std::string nothing_seen(const Scene& scene, const Truth& truth, const std::vector<Landmark>& landmarks) {
  if (landmarks.empty()) return "it has no landmark";
  double nearest = std::numeric_limits<double>::infinity(), farthest = -nearest;
  for (const auto& stop : truth.stops)
    for (std::size_t l = 0; l < landmarks.size(); ++l) {
      const double d =
          (*truth.landmarks[l] - Eigen::Vector2d(stop->x_m, stop->y_m)).norm() - landmarks[l].radius_m;
      nearest = std::min(nearest, d), farthest = std::max(farthest, d);
    }
  const std::string visible = std::isfinite(scene.visible_max_m)
                                  ? fmt::format("is {:g} to {:g} m", scene.visible_min_m, scene.visible_max_m)
                                  : fmt::format("begins at {:g} m", scene.visible_min_m);
  return fmt::format(
      "no landmark is seen from any stop: their surfaces are {:.3g} to {:.3g} m away, and visibility {}",
      nearest, farthest, visible);
}

/// Throws InputError where a simulation gave no reading at all, and says why; `source` is the file it was made from.
void require_readings(const Recording& recording, const Scene* scene, const std::string& source) {
  if (recording.readings.size() + recording.pairs.size() > 0) return;
  const Counts& counts = recording.counts;
  const Sensor& sensor = recording.sensor;
  std::string why = "nothing is seen";
  if (counts.read > 0)
    why = fmt::format("none of {} readings can be used: {}{}", counts.read, dropped_in_words(counts),
                      std::isfinite(sensor.range_max_m) ? fmt::format("; the sensor reads {:g} to {:g} m",
                                                                      sensor.range_min_m, sensor.range_max_m)
                                                        : "");
  else if (scene && recording.kind == RecordingKind::landmarks)
    why = nothing_seen(*scene, recording.truth, recording.landmarks);
  throw InputError(source, 0, "", "the recording would hold no reading: " + why);
}

/// Throws InputError where the recording would take the place of the file that it is made from.
void keep(const std::string& source, const std::string& folder) {
  require_replaceable(folder);
  require_apart(recording_files({folder}), {source});
}

/// Simulates the recordings of a diagnosis by the model it stands by: into the folder itself, or several below it.
int simulate_again(const std::string& diagnosis, const std::string& folder, std::uint64_t seed) {
  std::vector<Recording> recordings =
      simulate(simulation_model_from_json(read_file(diagnosis), diagnosis), seed);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    recordings[r].path = recordings.size() == 1 ? folder : fmt::format("{}/{}", folder, r + 1);
    require_readings(recordings[r], nullptr, diagnosis);
    keep(diagnosis, recordings[r].path);
  }
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    save_recording(recordings[r], recordings[r].path, "rangecal simulate");
    fmt::print("{}\n", describe({&recordings[r], 1}));
  }
  return done;
}

/// Who made the recording, and in comments what it holds beyond the seed model: truth, which no reader reads.
std::string maker_of(const std::string& departures) {
  std::string maker = "rangecal simulate";
  if (!departures.empty()) maker += "\n# with this in it, as its scene says it:";
  std::istringstream lines(departures);
  for (std::string line; std::getline(lines, line);) maker += "\n#   " + line;
  return maker;
}

int simulate_file(const std::string& path, const std::string& folder, std::uint64_t seed) {
  keep(path, folder);
  const Scene scene = load_scene(path, SceneScope::any);
  Recording recording = simulate_scene(scene, seed);
  require_readings(recording, &scene, path);
  const std::string departures = departures_text(scene);
  save_recording(recording, folder, maker_of(departures));
  recording.path = folder;
  fmt::print("{}; {}\n{}", describe({&recording, 1}), describe(recording.counts), departures);
  return done;
}

}  // namespace

void add_simulate(CLI::App& app, Action& chosen) {
  struct Options {
    std::string scene, diagnosis, folder;
    std::uint64_t seed = 1;
  };
  CLI::App* command = app.add_subcommand("simulate", "make a recording with ground truth from a scene file");
  const auto options = std::make_shared<Options>();
  command->add_option("SCENE", options->scene, "scene file (docs/scene.md)");
  command->add_option(
      "--from", options->diagnosis,
      "instead of a scene: what 'diagnose --json' wrote; its recordings again, effects included");
  command
      ->add_option("-o,--output", options->folder,
                   "folder of the recording, made if missing; a recording that was measured is not replaced")
      ->required();
  command->add_option("--seed", options->seed, "the same seed makes the same recording")
      ->check(whole())
      ->capture_default_str();
  add_effects_option(*command);
  command->footer(
      "A scene may hold catalogued effects or an optical sensor (docs/scene.md; 'rangecal effects' lists effects):\n"
      "  effects: {range_eccentricity: {cosine_m: 0.02}, quantisation: {output_step_m: 0.001}}\n"
      "  sensor: {model: optical, focal_mm: 14.5, nominal_focal_mm: 14.4, noise: {law: f2, sigma: 0.004},\n"
      "           sigma_theta_rad: 0.009}\n"
      "Examples:\n"
      "  rangecal simulate notebooks_data/scenes/field-layout.yaml -o sim --seed 7 && rangecal compare sim\n"
      "  rangecal simulate notebooks_data/scenes/field-layout-effects.yaml -o sim && rangecal diagnose sim\n"
      "  rangecal simulate notebooks_data/scenes/field-layout-optical.yaml -o sim && rangecal calibrate sim\n"
      "  rangecal diagnose REC --json d.json && rangecal simulate --from d.json -o sim");
  command->callback([options, &chosen] {
    chosen = [options] {
      if (options->scene.empty() == options->diagnosis.empty())
        throw InputError("give a scene file, or --from DIAGNOSIS");
      if (!options->diagnosis.empty())
        return simulate_again(options->diagnosis, options->folder, options->seed);
      return simulate_file(options->scene, options->folder, options->seed);
    };
  });
}

}  // namespace rangecal::app
