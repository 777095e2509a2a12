// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <string>

#include "fleet/fleet_job.hpp"

namespace rangecal::app {

/// `fleet` as it is given on the command line.
struct FleetCommand {
  FleetJob job;
  std::string noise = "f2", noise_shape = "auto", shard;

  /// Fills the job from what was given as text. Throws InputError for what is none.
  void prepare();
  /// What goes to stdout.
  std::string page(const FleetResult& result) const;
  /// Prints it and the notes; returns the exit code.
  int deliver(const FleetResult& result) const;
};

/// Declares `fleet` and its options, filled into `command`.
CLI::App* declare_fleet(CLI::App& app, FleetCommand& command);

}  // namespace rangecal::app
