// SPDX-License-Identifier: BSD-3-Clause
#include <unistd.h>

#include <cstdlib>
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "report/report.hpp"
#include "study/command.hpp"

namespace rangecal::app {
namespace {

/// Set by mpirun (OpenMPI; MPICH and Slurm) in every rank it starts.
bool started_by_mpirun() {
  for (const char* name : {"OMPI_COMM_WORLD_SIZE", "PMI_SIZE"}) {
    const char* size = std::getenv(name);
    if (size && std::atoi(size) > 1) return true;
  }
  return false;
}

/// The program that carries MPI stands beside this one, so that no other command needs MPI to start. Does not return
/// where it is there.
[[noreturn]] void become_mpi_program(const StudyJob& job) {
  const std::string program =
      (std::filesystem::read_symlink("/proc/self/exe").parent_path() / "rangecal-mpi").string();
  std::vector<std::string> words{program, "study", job.file, "-o", job.folder};
  if (job.resume) words.push_back("--resume");
  if (!job.shard_text.empty()) words.insert(words.end(), {"--shard", job.shard_text});
  for (const std::string& folder : job.merge) words.insert(words.end(), {"--merge", folder});
  std::vector<char*> arguments;
  for (std::string& word : words) arguments.push_back(word.data());
  arguments.push_back(nullptr);
  ::execv(program.c_str(), arguments.data());
  throw InputError("started by mpirun, but built without MPI (" + program +
                   " is missing): build with libopenmpi-dev installed, or use --shard");
}

}  // namespace

void add_study(CLI::App& app, Action& chosen) {
  const auto job = std::make_shared<StudyJob>();
  const auto page = std::make_shared<std::string>();
  CLI::App* command = declare_study(app, *job);
  command->add_option("--report", *page, "one HTML file with the measures as charts (not under mpirun)");
  command->callback([job, page, &chosen] {
    chosen = [job, page] {
      if (started_by_mpirun()) become_mpi_program(*job);
      if (!page->empty()) report::require_available();
      const Study study = study_of(*job);
      StudyFolder folder(study, *job);
      run_study(study, folder.options());
      const int code = folder.finish();
      if (!page->empty())
        write_file(*page, report::study_page(study.name, CsvTable::read(job->folder + "/results.csv")));
      return code;
    };
  });
}

}  // namespace rangecal::app
