// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

namespace rangecal::app {

/// Exit codes (README.md): done; the work ran but could not deliver; bad input or usage.
enum Exit { done = 0, not_delivered = 1, bad_input = 2 };

/// What a subcommand does once its options are parsed; returns the exit code.
using Action = std::function<int()>;

/// Each declares one subcommand and sets `chosen` when it is the one given.
void add_calibrate(CLI::App& app, Action& chosen);
void add_compare(CLI::App& app, Action& chosen);
void add_correct(CLI::App& app, Action& chosen);
void add_simulate(CLI::App& app, Action& chosen);
void add_diagnose(CLI::App& app, Action& chosen);
void add_effects(CLI::App& app, Action& chosen);
/// `--effects DIR`: makes the effects by formula of a folder known when it is read, and keeps its name in `folders`, if any.
void add_effects_option(CLI::App& command, std::vector<std::string>* folders = nullptr);
void add_export(CLI::App& app, Action& chosen);
void add_extract(CLI::App& app, Action& chosen);
void add_fleet(CLI::App& app, Action& chosen);
void add_import(CLI::App& app, Action& chosen);
void add_plan(CLI::App& app, Action& chosen);
void add_predict(CLI::App& app, Action& chosen);
void add_prove(CLI::App& app, Action& chosen);
void add_study(CLI::App& app, Action& chosen);
void add_track(CLI::App& app, Action& chosen);

}  // namespace rangecal::app
