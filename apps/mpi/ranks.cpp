// SPDX-License-Identifier: BSD-3-Clause
#include "mpi/ranks.hpp"

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

namespace fs = std::filesystem;

std::string part_of(const std::string& output, int rank) {
  return fmt::format("{}.part-{}", output, rank + 1);
}

/// What the ranks left, those that died and those of a run before too: their files, and what SQLite and locks put beside these (the
/// empty journal of a rank that was killed as it began a transaction, say).
struct Parts {
  std::vector<std::string> databases, others;
};

Parts parts_of(const std::string& output) {
  const std::string begin = fs::path(output).filename().string() + ".part-";
  const fs::path folder = fs::path(output).parent_path();
  Parts found;
  std::error_code none;
  for (const auto& entry : fs::directory_iterator(folder.empty() ? fs::path(".") : folder, none)) {
    const std::string name = entry.path().filename().string();
    if (!name.starts_with(begin)) continue;
    const std::size_t end = name.find_first_not_of("0123456789", begin.size());
    if (end == begin.size() || name.size() == begin.size()) continue;  // no rank's number
    const std::string rest = end == std::string::npos ? "" : name.substr(end);
    if (rest.empty()) found.databases.push_back((folder / name).string());
    if (rest == ".lock" || rest == "-journal") found.others.push_back((folder / name).string());
  }
  std::sort(found.databases.begin(), found.databases.end());
  return found;
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

/// Another rank could not begin, and said why.
struct OthersFailed {};

/// Ends the run where this rank fails when the others do not wait for it any more: they go on without it.
int alone_failed(const std::string& complaint) {
  fmt::print(stderr, "rangecal: {}\n", complaint);
  return bad_input;
}

}  // namespace

int run_on_ranks(const RankedWork& given, int rank, int size) {
  if (!all_well(complaint_of(given.prepare), rank, size)) return bad_input;
  const std::string file = given.output + ".queue";
  int alone = rank == 0 && file_exists(given.output) && !file_exists(file);
  MPI_Bcast(&alone, 1, MPI_INT, 0, MPI_COMM_WORLD);
  std::optional<WorkQueue> queue;
  if (!alone) {
    const std::string part = part_of(given.output, rank);
    const bool fresh = !file_exists(part);
    const auto give_up = [&] {  // nothing was begun: no empty file stays behind
      std::error_code ignored;
      if (fresh) fs::remove(part, ignored);
      return bad_input;
    };
    bool begun = false;
    UnitShare share;
    share.queue = [&](std::int64_t units, std::uint64_t work) -> WorkQueue* {
      // rank 0 makes the queue before any other can come to its end
      const auto unmade = complaint_of([&] {
        if (rank == 0) queue.emplace(file, units, work);
      });
      begun = true;
      if (!all_well(unmade, rank, size)) throw OthersFailed();
      MPI_Finalize();  // which waits for all ranks, too: from here on any may die
      if (rank > 0) queue = WorkQueue::join(file, units, work);
      return queue ? &*queue : nullptr;
    };
    try {
      const auto complaint = complaint_of([&] { given.work(share, part); });
      if (!begun) {
        all_well(complaint.value_or("there are no units"), rank, size);
        return give_up();
      }
      if (complaint) return alone_failed(*complaint);
    } catch (const OthersFailed&) {
      return give_up();
    }
    if (!queue || !queue->finishes()) return done;
  } else if (rank > 0) {
    return done;
  }
  int code = done;
  const auto complaint = complaint_of(
      [&] { code = given.finish(alone ? std::vector<std::string>() : parts_of(given.output).databases); });
  if (complaint) return alone_failed(*complaint);
  if (!alone) {
    const Parts parts = parts_of(given.output);
    std::error_code ignored;
    for (const auto* files : {&parts.databases, &parts.others})
      for (const std::string& file : *files) fs::remove(file, ignored);
  }
  if (queue) queue->finished();
  return code;
}

}  // namespace rangecal::app
