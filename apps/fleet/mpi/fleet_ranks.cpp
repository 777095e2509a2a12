// SPDX-License-Identifier: BSD-3-Clause
#include "fleet/mpi/fleet_ranks.hpp"

#include <fmt/core.h>
#include <mpi.h>

#include <algorithm>
#include <cstdio>
#include <filesystem>
#include <optional>
#include <system_error>

#include "commands.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::app {
namespace {

/// Ranks count from 0, their files from 1, as shards do.
std::string file_of(const std::string& output, int rank, int size) {
  return fmt::format("{}.{}-of-{}", output, rank + 1, size);
}

/// The first rank that failed says why; true where none did. All ranks wait for each other here.
bool all_well(const std::optional<std::string>& complaint, int rank, int size) {
  const int mine = complaint ? rank : size;
  int first = size;
  MPI_Allreduce(&mine, &first, 1, MPI_INT, MPI_MIN, MPI_COMM_WORLD);
  if (first == rank) fmt::print(stderr, "rangecal: {}\n", *complaint);
  return first == size;
}

/// What `work` complained of, if it did.
template <typename Work>
std::optional<std::string> complaint_of(Work&& work) {
  try {
    work();
    return std::nullopt;
  } catch (const std::exception& error) {
    return error.what();
  }
}

}  // namespace

int run_fleet_ranks(FleetCommand& given, int rank, int size) {
  FleetJob& job = given.job;
  const auto unfit = complaint_of([&] {
    given.prepare();
    if (!given.shard.empty() || !job.merge.empty())
      throw InputError("--shard and --merge are for runs without mpirun");
  });
  if (!all_well(unfit, rank, size)) return bad_input;

  int alone = 0;
  if (rank == 0 && file_exists(job.output)) {
    alone = 1;
    for (int r = 0; r < size; ++r) alone = alone && !file_exists(file_of(job.output, r, size));
  }
  MPI_Bcast(&alone, 1, MPI_INT, 0, MPI_COMM_WORLD);
  if (!alone) {
    FleetJob part = job;
    part.output = file_of(job.output, rank, size);
    part.csv.clear();
    part.shard = rank;
    part.shards = size;
    part.threads = std::max(1, job.threads);  // the other ranks may stand on the same machine
    if (!all_well(complaint_of([&] { run_fleet(part); }), rank, size)) return bad_input;
    job.inputs.clear();
    for (int r = 0; r < size; ++r) job.merge.push_back(file_of(job.output, r, size));
  }
  int code = done;
  std::optional<std::string> failed;
  if (rank == 0)
    failed = complaint_of([&] {
      code = given.deliver(run_fleet(job));
      std::error_code ignored;
      for (const std::string& file : job.merge) std::filesystem::remove(file, ignored);
    });
  return all_well(failed, rank, size) ? code : bad_input;
}

}  // namespace rangecal::app
