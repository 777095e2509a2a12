// SPDX-License-Identifier: BSD-3-Clause
#include <filesystem>
#include <memory>

#include "commands.hpp"
#include "mpi_program.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
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

/// The one path of a file, which need not be there yet.
std::filesystem::path place_of_file(const std::filesystem::path& path) {
  std::error_code error;
  const std::filesystem::path place =
      std::filesystem::weakly_canonical(std::filesystem::absolute(path), error);
  return error ? std::filesystem::absolute(path).lexically_normal() : place;
}

/// Throws InputError for a page that cannot be written, or takes the place of what the study reads or writes: before its
/// folder is begun, which the corrected command would have to --resume.
void check_page(const std::string& page, const Study& study, const StudyJob& job) {
  require_apart({page}, study.files);
  for (const std::string& folder : job.merge) require_apart({page}, journals_in(folder));
  require_apart({page}, journals_in(job.folder));
  const std::filesystem::path place = place_of_file(page);
  bool in_folder = false;  // which may have to be made
  for (const std::string& file : result_files(job)) {
    if (place_of_file(file) == place) throw InputError(page, 0, "", "is named as the file of two results");
    in_folder = in_folder || place_of_file(file).parent_path() == place.parent_path();
  }
  if (in_folder && names_journal(place.filename().string()))
    throw InputError(page, 0, "", "has the name of a journal: every shard would read it as one");
  if (!in_folder || file_exists(job.folder)) require_writable(page);
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
      if (!page->empty()) check_page(*page, study, *job);
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
