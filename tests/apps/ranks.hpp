// SPDX-License-Identifier: BSD-3-Clause
// Commands under mpirun, and ranks that are killed.
#pragma once

#include <fmt/format.h>
#include <gtest/gtest.h>
#include <signal.h>

#include <chrono>
#include <filesystem>
#include <ios>
#include <string>
#include <thread>
#include <vector>

#include "apps/run_binary.hpp"
#include "fleet/database.hpp"

namespace rangecal::test {

inline bool has_ranks() {
  return std::filesystem::exists(std::filesystem::path(RANGECAL_BINARY).parent_path() / "rangecal-mpi");
}
/// Whether mpirun lets the others live where a rank dies.
inline bool ranks_may_die() {
  const TemporaryFolder folder;
  const std::string out = folder.file("out");
  return std::system(("mpirun --version > " + out + " 2>&1").c_str()) == 0 &&
         slurp(out).find("(Open MPI) 4.") != std::string::npos;
}

/// What stands in front of a command.
inline std::string on_ranks(int ranks, const std::string& options = "") {
  return fmt::format(
      "OMPI_ALLOW_RUN_AS_ROOT=1 OMPI_ALLOW_RUN_AS_ROOT_CONFIRM=1 timeout 200 mpirun --oversubscribe {} --mca btl self,tcp "
      "--mca btl_tcp_if_include lo -n {}",
      options, ranks);
}

/// How many files of a run that has not ended there are beside its output.
inline int files_beside(const std::string& output) {
  const std::filesystem::path path(output);
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(path.parent_path()))
    count += entry.path().filename().string().starts_with(path.filename().string() + ".");
  return count;
}

/// Runs a command that writes `output` on so many ranks, and kills some of them once units are kept.
inline RunResult run_and_kill_ranks(const std::string& command, const std::string& output, int ranks,
                                    const std::vector<int>& victims) {
  namespace fs = std::filesystem;
  RunResult result;
  std::jthread running([&] { result = run(command, "", on_ranks(ranks, "--enable-recovery")); });
  const auto units_kept = [&] {
    for (int rank = 1; rank <= ranks; ++rank) try {
        const std::string part = fmt::format("{}.part-{}", output, rank);
        if (!fs::exists(part)) continue;
        app::Database database(part);
        const std::string table =
            database.count("SELECT count(*) FROM sqlite_master WHERE name = 'units'") > 0 ? "units"
                                                                                          : "diagnoses";
        if (database.count("SELECT count(*) FROM " + table) > 0) return true;
      } catch (const std::exception&) {  // its tables are being made
      }
    return false;
  };
  for (int i = 0; i < 3000 && !units_kept(); ++i) std::this_thread::sleep_for(std::chrono::milliseconds(10));
  std::this_thread::sleep_for(std::chrono::milliseconds(300));  // until every rank has begun
  std::size_t killed = 0;
  for (const auto& entry : fs::directory_iterator("/proc")) {
    const std::string name = entry.path().filename().string();
    if (name.find_first_not_of("0123456789") != std::string::npos) continue;
    std::string words, environment;
    try {
      words = slurp(entry.path() / "cmdline"), environment = slurp(entry.path() / "environ");
    } catch (const std::ios_base::failure&) {  // it has ended since it was listed
      continue;
    }
    if (words.find("rangecal-mpi") == std::string::npos || words.find(output) == std::string::npos) continue;
    for (const int rank : victims) {
      const std::string says = fmt::format("OMPI_COMM_WORLD_RANK={}", rank) + '\0';
      if (environment.find(says) != std::string::npos) killed += ::kill(std::stoi(name), SIGKILL) == 0;
    }
  }
  running.join();
  EXPECT_EQ(killed, victims.size());
  return result;
}

}  // namespace rangecal::test
