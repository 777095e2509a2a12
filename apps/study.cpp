// SPDX-License-Identifier: BSD-3-Clause
#include <memory>

#include "commands.hpp"
#include "mpi_program.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/files.hpp"
#include "report/report.hpp"
#include "study/command.hpp"

namespace rangecal::app {
namespace {

/// The same command for the program that carries MPI.
std::vector<std::string> words_of(const StudyJob& job) {
  std::vector<std::string> words{"study", job.file, "-o", job.folder};
  if (job.resume) words.push_back("--resume");
  if (!job.shard_text.empty()) words.insert(words.end(), {"--shard", job.shard_text});
  for (const std::string& folder : job.merge) words.insert(words.end(), {"--merge", folder});
  return words;
}

}  // namespace

void add_study(CLI::App& app, Action& chosen) {
  const auto job = std::make_shared<StudyJob>();
  const auto page = std::make_shared<std::string>();
  CLI::App* command = declare_study(app, *job);
  command->add_option("--report", *page, "one HTML file with the measures as charts (not under mpirun)");
  command->callback([job, page, &chosen] {
    chosen = [job, page] {
      if (started_by_mpirun()) become_mpi_program(words_of(*job), "use --shard");
      if (!page->empty()) report::require_available();
      const Study study = study_of(*job);
      require_apart({*page}, study.files);
      StudyFolder folder(study, *job);
      if (!page->empty()) {
        require_writable({*page, job->folder + "/results.csv", job->folder + "/timing.csv"});
        for (const std::string& read : job->merge) require_apart({*page}, journals_in(read));
        require_apart({*page}, journals_in(job->folder));
      }
      run_study(study, folder.options());
      const int code = folder.finish();
      if (!page->empty())
        write_file(*page, report::study_page(study.name, CsvTable::read(job->folder + "/results.csv")));
      return code;
    };
  });
}

}  // namespace rangecal::app
