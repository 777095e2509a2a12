// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>

#include "study/folder.hpp"

namespace rangecal::app {

/// Declares `study` and its options, filled into `job`.
CLI::App* declare_study(CLI::App& app, StudyJob& job);

}  // namespace rangecal::app
