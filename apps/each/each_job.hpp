// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <cstdint>
#include <string>
#include <vector>

#include "fleet/pending_units.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::app {

/// `diagnose --each`: a diagnosis of every recording for itself, a row each.
struct EachJob {
  std::vector<std::string> inputs;  ///< recordings, folders of recordings
  std::vector<std::string> merge;   ///< files of other shares, to be taken in
  std::string output, page;         ///< SQLite file; page of HTML, or empty
  std::vector<std::string> group_by, force, without;
  std::string curve = "auto";
  double alarm_rate = 0.02;  ///< of each recording
  int threads = 0;           ///< recordings at a time; 0: as many as there are cores
  UnitShare share;
  bool progress = false;

  /// Declares what is only of --each.
  void add_to(CLI::App& command);
  /// Of each diagnosis. Throws InputError for a curve that is none.
  DiagnoseOptions options() const;
  /// Throws InputError for what was asked wrongly, before any work.
  void check() const;
};

struct EachResult {
  std::int64_t recordings = 0, unreadable = 0;
  std::int64_t resumed = 0;                                    ///< were there already
  std::vector<std::pair<std::string, std::int64_t>> verdicts;  ///< how many of each
  std::vector<std::string> notes;
};

/// Diagnoses every recording that is not yet in `output` or changed since, and writes the page. A row is kept as soon as it is there: a
/// killed run goes on in its file. A recording that cannot be read, or diagnosed, has its reason in its row. Tables: `inputs` (name,
/// identity), `meta` (what was asked), and `diagnoses`, whose columns docs/diagnosis.md lists. Throws InputError for inputs that are none,
/// before `output` is made, where it was made with other options, and where another run is writing it.
EachResult run_each(const EachJob& job);

/// What goes to stdout: how many there are of each verdict.
std::string describe(const EachJob& job, const EachResult& result);

}  // namespace rangecal::app
