// SPDX-License-Identifier: BSD-3-Clause
#include "study/command.hpp"

namespace rangecal::app {

CLI::App* declare_study(CLI::App& app, StudyJob& job) {
  CLI::App* command = app.add_subcommand("study", "run a Monte-Carlo accuracy study");
  command->add_option("STUDY", job.file, "study file (docs/study.md)")->required();
  command->add_option("-o,--output", job.folder, "folder of the results, made if missing")->required();
  command->add_flag("--resume", job.resume, "continue what the folder holds, all shards in it put together");
  command->add_option("--merge", job.merge,
                      "folders of other shards, put together with what the output folder holds");
  command->add_option("--shard", job.shard_text, "I/N: this run does part I of N, for job arrays");
  command->add_option("--threads", job.threads, "threads (default: all cores); under mpirun one per rank");
  command->footer(
      "Results are the same bits for any threads, ranks and shards; they stand in OUTPUT/results.csv as points complete.\n"
      "A run that was killed goes on with --resume. Examples:\n"
      "  rangecal study notebooks_data/studies/quick.yaml -o quick\n"
      "  mpirun -n 4 rangecal study STUDY.yaml -o out\n"
      "  rangecal study STUDY.yaml -o out --shard 2/8      (with 1/8 .. 8/8, then: rangecal study STUDY.yaml -o out --resume)");
  return command;
}

}  // namespace rangecal::app
