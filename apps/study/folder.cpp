// SPDX-License-Identifier: BSD-3-Clause
#include "study/folder.hpp"

#include <fmt/core.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <filesystem>

#include "commands.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"
#include "rangecal/solvers/study/table.hpp"
#include "shard.hpp"

namespace rangecal::app {
namespace {

using namespace std::chrono_literals;

std::string join(const std::string& header, const std::map<int, std::string>& rows) {
  std::string text = header;
  for (const auto& [point, lines] : rows) text += lines;
  return text;
}

std::string journal_name(const StudyJob& job) {
  return job.shards == 1 ? "journal.txt" : fmt::format("journal-{}-of-{}.txt", job.shard + 1, job.shards);
}

/// What a kill between writing and renaming left behind.
void remove_partial_tables(const std::string& folder) {
  std::error_code none;
  std::vector<std::filesystem::path> partial;
  for (const auto& entry : std::filesystem::directory_iterator(folder, none)) {
    const std::string name = entry.path().filename().string();
    if (name.starts_with("results.csv.partial") || name.starts_with("timing.csv.partial"))
      partial.push_back(entry.path());
  }
  for (const auto& path : partial) std::filesystem::remove(path, none);
}

std::string clock_text(double seconds) {
  const long s = std::lround(seconds);
  return s >= 3600 ? fmt::format("{}:{:02}:{:02}", s / 3600, s / 60 % 60, s % 60)
                   : fmt::format("{}:{:02}", s / 60, s % 60);
}

}  // namespace

std::vector<std::string> result_files(const StudyJob& job) {
  const std::filesystem::path folder(job.folder);
  return {(folder / "results.csv").string(), (folder / "timing.csv").string(),
          (folder / journal_name(job)).string()};
}

Study study_of(StudyJob& job) {
  const Shard shard = shard_from(job.shard_text);
  job.shard = shard.index;
  job.shards = shard.count;
  if (job.threads < 0) throw InputError(fmt::format("--threads {}: is negative", job.threads));
  Study study = load_study(job.file);
  require_apart(result_files(job), study.files);
  return study;
}

StudyFolder::StudyFolder(const Study& study, const StudyJob& job)
    : study_(study), job_(job), terminal_(::isatty(STDERR_FILENO) != 0) {
  const std::string mine = (std::filesystem::path(job.folder) / journal_name(job)).string();
  for (const std::string& folder : job.merge)
    if (journals_in(folder).empty()) throw InputError(folder, 0, "", "holds no journal of a study");
  const bool begun = job.shards > 1 ? file_exists(mine) : !journals_in(job.folder).empty();
  if (begun && !job.resume && job.merge.empty())
    throw InputError(job.folder, 0, "", "holds a study already begun; --resume continues it");
  make_folder(job.folder);
  lock_.emplace((std::filesystem::path(job.folder) / "").string(), job.shards > 1);
  std::vector<std::string> folders{job.folder};
  folders.insert(folders.end(), job.merge.begin(), job.merge.end());
  known_ = std::make_unique<JournalReader>(study, folders);
  journal_ = std::make_unique<JournalWriter>(study, mine);
  if (job.shards == 1) remove_partial_tables(job.folder);  // shards write none
  const int pieces = study_pieces(study);
  for (int p = 0; p < static_cast<int>(study.points.size()); ++p)
    for (int c = 0; c < pieces; ++c) {
      if ((static_cast<long>(p) * pieces + c) % job.shards != job.shard) continue;
      const int repeats = study_unit_repeats(study, {p, c});
      repeats_asked_ += repeats;
      if (known_->knows({p, c})) repeats_known_ += repeats;
    }
}

StudyOptions StudyFolder::options() {
  StudyOptions options;
  options.threads = job_.threads;
  options.shard = job_.shard;
  options.shards = job_.shards;
  options.is_known = [this](const StudyUnit& unit) { return known_->knows(unit); };
  options.recall = [this](const StudyUnit& unit) { return known_->recall(unit); };
  options.on_unit = [this](const StudyUnit& unit, const StudySums& sums) { on_unit(unit, sums); };
  options.on_point = [this](const StudyPointResult& result) { on_point(result); };
  return options;
}

void StudyFolder::on_unit(const StudyUnit& unit, const StudySums& sums) {
  journal_->append(unit, sums);
  repeats_run_ += sums.repeats;
  if (terminal_) show_progress(false);
}

void StudyFolder::on_point(const StudyPointResult& result) {
  results_[result.point] = study_csv_rows(study_, result);
  if (study_.measures_any({StudyMeasure::time})) timing_[result.point] = timing_csv_rows(study_, result);
  if (Clock::now() - written_ < 500ms) return;  // many short points: the journal has them, the table follows
  write_tables();
  written_ = Clock::now();
}

void StudyFolder::write_tables() const {
  const std::filesystem::path folder(job_.folder);
  write_file((folder / "results.csv").string(), join(study_csv_header(study_), results_));
  if (study_.measures_any({StudyMeasure::time}))
    write_file((folder / "timing.csv").string(), join(timing_csv_header(study_), timing_));
}

void StudyFolder::show_progress(bool last) {
  const auto now = Clock::now();
  if (!last && now - shown_ < 200ms) return;
  shown_ = now;
  const double rate =
      static_cast<double>(repeats_run_) / std::max(std::chrono::duration<double>(now - begin_).count(), 1e-3);
  const long left = repeats_asked_ - repeats_known_ - repeats_run_;
  fmt::print(stderr, "\r\x1b[K{}: {} of {} repeats, {:.0f}/s, {} left{}", study_.name,
             repeats_known_ + repeats_run_, repeats_asked_, rate,
             clock_text(static_cast<double>(left) / std::max(rate, 1e-9)), last ? "\n" : "");
}

int StudyFolder::finish() {
  if (terminal_) show_progress(true);
  if (job_.shards > 1) {
    fmt::print(
        "{}: shard {}/{} done, {} repeats run, {} known before. With all shards done:\n"
        "  rangecal study {} -o {} --resume\n",
        study_.name, job_.shard + 1, job_.shards, repeats_run_, repeats_known_, job_.file, job_.folder);
    return done;
  }
  write_tables();
  fmt::print("{}: {} point{} of {} repeats ({} run, {} known before), {} estimator{}, {:.2f} s: {}\n",
             study_.name, study_.points.size(), study_.points.size() == 1 ? "" : "s", study_.repeats,
             repeats_run_, repeats_known_, study_.estimators.size(), study_.estimators.size() == 1 ? "" : "s",
             std::chrono::duration<double>(Clock::now() - begin_).count(),
             (std::filesystem::path(job_.folder) / "results.csv").string());
  return done;
}

}  // namespace rangecal::app
