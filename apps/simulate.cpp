// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cstdint>
#include <memory>

#include "commands.hpp"
#include "rangecal/core/recording_io.hpp"
#include "rangecal/problems/world/polynomial_world.hpp"
#include "rangecal/problems/world/scene.hpp"
#include "text.hpp"

namespace rangecal::app {

void add_simulate(CLI::App& app, Action& chosen) {
  struct Options {
    std::string scene, folder;
    std::uint64_t seed = 1;
  };
  CLI::App* command = app.add_subcommand("simulate", "make a recording with ground truth from a scene file");
  const auto options = std::make_shared<Options>();
  command->add_option("SCENE", options->scene, "scene file (docs/scene.md)")->required();
  command->add_option("-o,--output", options->folder, "folder of the recording, made if missing")->required();
  command->add_option("--seed", options->seed, "the same seed makes the same recording")
      ->capture_default_str();
  command->footer(
      "Example:\n"
      "  rangecal simulate notebooks_data/scenes/field-layout.yaml -o sim --seed 7 && rangecal compare sim");
  command->callback([options, &chosen] {
    chosen = [options] {
      Recording recording = simulate(load_scene(options->scene), options->seed);
      save_recording(recording, options->folder);
      recording.path = options->folder;
      const Recording one[] = {recording};
      fmt::print("{}; {}\n", describe(one), describe(recording.counts));
      return static_cast<int>(done);
    };
  });
}

}  // namespace rangecal::app
