// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "rangecal/solvers/diagnosis/simulation_model.hpp"
#include "text.hpp"

namespace rangecal::app {

namespace {

/// Simulates the recordings of a diagnosis by the model it stands by: into the folder itself, or several below it.
int simulate_again(const std::string& diagnosis, const std::string& folder, std::uint64_t seed) {
  std::vector<Recording> recordings =
      simulate(simulation_model_from_json(read_file(diagnosis), diagnosis), seed);
  for (std::size_t r = 0; r < recordings.size(); ++r) {
    recordings[r].path = recordings.size() == 1 ? folder : fmt::format("{}/{}", folder, r + 1);
    require_replaceable(recordings[r].path);
    save_recording(recordings[r], recordings[r].path, "rangecal simulate");
    fmt::print("{}\n", describe({&recordings[r], 1}));
  }
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
  command->footer(
      "Example:\n"
      "  rangecal simulate notebooks_data/scenes/field-layout.yaml -o sim --seed 7 && rangecal compare sim\n"
      "  rangecal diagnose REC --json d.json && rangecal simulate --from d.json -o sim");
  command->callback([options, &chosen] {
    chosen = [options] {
      if (options->scene.empty() == options->diagnosis.empty())
        throw InputError("give a scene file, or --from DIAGNOSIS");
      if (!options->diagnosis.empty())
        return simulate_again(options->diagnosis, options->folder, options->seed);
      require_replaceable(options->folder);
      Recording recording = simulate(load_scene(options->scene), options->seed);
      save_recording(recording, options->folder, "rangecal simulate");
      recording.path = options->folder;
      const Recording one[] = {recording};
      fmt::print("{}; {}\n", describe(one), describe(recording.counts));
      return static_cast<int>(done);
    };
  });
}

}  // namespace rangecal::app
