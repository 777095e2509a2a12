// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/core.h>

#include <cstdio>
#include <memory>
#include <string>

#include "commands.hpp"
#include "numbers.hpp"
#include "rangecal/core/calibration_io.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "simulator_export.hpp"

namespace rangecal::app {
namespace {

struct ExportCommand {
  std::string calibration, to, output;
  double tolerance = 1e-3;

  int run() const {
    require_apart({output, "/dev/stdout"}, {calibration});
    require_writable(output);
    const Calibration loaded = load_calibration(calibration);
    require_curve(loaded, calibration);
    const ExportedText found = made_of(loaded);
    if (output.empty())
      fmt::print("{}", found.text);
    else
      write_file(output, found.text);
    for (const std::string& note : found.notes) fmt::print(stderr, "rangecal: {}\n", note);
    return done;
  }

 private:
  ExportedText made_of(const Calibration& loaded) const {
    const SimulatorExport options{calibration, tolerance};
    if (to == "webots") return webots_sensor(loaded, options);
    if (to == "gazebo") return gazebo_sensor(loaded, options);
    if (to == "csv") return table_csv(loaded, options);
    if (to == "urdf") return urdf_joint(loaded, options);
    throw InputError("--to is '" + to + "', not webots, gazebo, csv or urdf");
  }
};

}  // namespace

void add_export(CLI::App& app, Action& chosen) {
  CLI::App* command =
      app.add_subcommand("export", "tell a simulator what the sensor is: its curve, noise and place");
  const auto state = std::make_shared<ExportCommand>();
  command
      ->add_option("CALIBRATION", state->calibration,
                   "what 'calibrate --json' or 'diagnose --calibration' wrote")
      ->required();
  command->add_option("--to", state->to, "webots, gazebo, csv or urdf")->required();
  command->add_option("-o,--output", state->output, "file; stdout if left out");
  command
      ->add_option("--tolerance", state->tolerance,
                   "of the tables of webots and csv: how far mean and standard deviation may be off [m]")
      ->check(positive())
      ->capture_default_str();
  command->footer(
      "webots: a DistanceSensor whose lookupTable (distance, reading, relative noise) has the fewest rows for --tolerance.\n"
      "gazebo: SDF of a lidar: range, pose, and the constant noise that comes nearest. csv: the table of webots as distance_m,\n"
      "reading_m, relative_std, both linear between rows. urdf: a fixed joint, origin and yaw of the sensor (lever_arm, bearing_offset).\n"
      "How exact the file is and what the format cannot hold, with its size in mm, stands in its head and on stderr.\n"
      "Exit code 1: urdf of a calibration that says nothing of the place (docs/export.md).\n"
      "\n"
      "Examples:\n"
      "  rangecal export cal.json --to webots --tolerance 0.0005 -o DistanceSensor.txt\n"
      "  rangecal export cal.json --to gazebo > lidar.sdf");
  command->callback([state, &chosen] { chosen = [state] { return state->run(); }; });
}

}  // namespace rangecal::app
