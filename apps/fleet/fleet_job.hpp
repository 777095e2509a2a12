// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "fleet/pending_units.hpp"
#include "rangecal/solvers/fleet/population.hpp"

namespace rangecal::app {

struct FleetJob {
  std::vector<std::string> inputs;  ///< recordings, folders of recordings
  std::vector<std::string> merge;   ///< files of other shards
  std::string output, csv;
  int order = 2;
  NoiseLaw law = NoiseLaw::f_squared;
  NoiseShape noise_shape = NoiseShape::automatic;  ///< of each unit for itself
  UnitShare share;                                 ///< of the units, all of them if nothing is said
  int diagnoses = 20;                              ///< at most, of units that are odd
  double alarm_rate = 0.01;                        ///< of naming any unit of a faultless fleet
  int threads = 0;                                 ///< 0: all
  bool progress = false;
};

struct FleetResult {
  std::int64_t units = 0, fitted = 0, unreadable = 0, few = 0;  ///< few: too few readings to be fitted alone
  std::int64_t resumed = 0, refitted = 0;  ///< there already; there, but their files changed
  std::int64_t renewed = 0;                ///< there, but fitted by another version
  std::int64_t by_population = 0, odd = 0;
  bool partial = false;  ///< a share of the units: no population yet
  Population population;
  std::vector<std::string> notes;  ///< units that were read once and are gone now
};

/// Fits every unit not yet in the file or changed since, the population, each unit's posterior, and the oddities, all in `output`. Every
/// stage is one or many transactions: a killed run goes on where the last one ended, to the same rows, and tries the units
/// again that could not be read. Throws InputError for inputs that are none, before `output` is made, and where another run
/// is writing it.
FleetResult run_fleet(const FleetJob& job);

}  // namespace rangecal::app
