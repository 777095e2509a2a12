// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <unistd.h>

#include <memory>

#include "commands.hpp"
#include "fleet/command.hpp"
#include "mpi_program.hpp"

namespace rangecal::app {
namespace {

/// The same command for the program that carries MPI.
std::vector<std::string> words_of(const FleetCommand& given) {
  const FleetJob& job = given.job;
  std::vector<std::string> words{"fleet"};
  words.insert(words.end(), job.inputs.begin(), job.inputs.end());
  for (const std::string& file : job.merge) words.insert(words.end(), {"--merge", file});
  if (!given.shard.empty()) words.insert(words.end(), {"--shard", given.shard});
  if (!job.csv.empty()) words.insert(words.end(), {"--csv", job.csv});
  words.insert(words.end(),
               {"-o", job.output, "--order", std::to_string(job.order), "--noise", given.noise,
                "--noise-shape", given.noise_shape, "--diagnose", std::to_string(job.diagnoses),
                "--alarm-rate", fmt::format("{}", job.alarm_rate), "--threads", std::to_string(job.threads)});
  return words;
}

}  // namespace

void add_fleet(CLI::App& app, Action& chosen) {
  const auto given = std::make_shared<FleetCommand>();
  CLI::App* command = declare_fleet(app, *given);
  command->callback([given, &chosen] {
    chosen = [given] {
      if (started_by_mpirun()) become_mpi_program(words_of(*given), "use --shard and --merge");
      given->prepare();
      given->job.progress = ::isatty(STDERR_FILENO) != 0;
      return given->deliver(run_fleet(given->job));
    };
  });
}

}  // namespace rangecal::app
