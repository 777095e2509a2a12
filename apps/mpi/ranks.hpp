// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "fleet/pending_units.hpp"

namespace rangecal::app {

/// Work over recordings whose results go into one SQLite file, as every rank has it.
struct RankedWork {
  std::string output;
  std::function<void()> prepare;  ///< throws InputError for what was asked wrongly
  /// Works at a share of the units and keeps what it finds in a file of its own.
  std::function<void(const UnitShare& share, const std::string& part)> work;
  /// Takes these files in and does all the rest; returns the exit code.
  std::function<int(const std::vector<std::string>& parts)> finish;
};

/// Called on every rank. Units are shared by the queue OUTPUT.queue (core/work_queue.hpp), each rank keeps its own in OUTPUT.part-RANK, and when
/// all are done one of them takes these in, finishes, and removes them. Once all ranks have begun, MPI is ended and any of them may die, as far as the launcher
/// lets the others live (Open MPI: --enable-recovery): its unit goes to another, its file is taken in with the others. After a kill of all,
/// any number of ranks goes on. Where OUTPUT stands already without a queue, rank 0 goes on in it alone. Returns the exit code.
int run_on_ranks(const RankedWork& given, int rank, int size);

}  // namespace rangecal::app
