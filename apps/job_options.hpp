// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <chrono>
#include <map>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/solvers/calibrate.hpp"

namespace rangecal::app {

/// The options that `calibrate` and `compare` share, as texts of the command line.
struct JobOptions {
  std::vector<std::string> recordings, group_by;
  std::string order = "auto", curve = "auto", noise = "auto", solver = "block", shape = "auto",
              weights = "consistent", criterion = "aic";
  bool check = false;

  void add_to(CLI::App& command);
  /// Throws InputError for a text that is not accepted.
  CalibrateOptions parsed() const;
};

/// Runs a job with progress on stderr where that is a terminal, and fills in each method's seconds. Throws InputError
/// where the recordings are too few for every method.
CalibrationReport run_job(const std::vector<Recording>& recordings, CalibrateOptions options);

}  // namespace rangecal::app
