// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <chrono>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include "rangecal/core/write_lock.hpp"
#include "study/journal.hpp"

namespace rangecal::app {

/// What `rangecal study` is asked for.
struct StudyJob {
  std::string file, folder;
  std::vector<std::string> merge;  ///< folders of other shards, to be read besides
  bool resume = false;
  int shard = 0, shards = 1;  ///< from 0
  int threads = 0;

  std::string shard_text;  ///< "2/8" as given
};

/// A study's folder: the journal while it runs, results.csv and timing.csv as points complete.
class StudyFolder {
 public:
  /// Opens or makes the folder. Throws InputError where it holds a study begun earlier and neither --resume nor
  /// --merge is given, and where another run is writing there: a whole one, or the same shard.
  StudyFolder(const Study& study, const StudyJob& job);

  /// Options whose callbacks read and write this folder.
  StudyOptions options();
  /// Writes the tables a last time, ends the progress line, and says on stdout what there is; the exit code.
  int finish();

 private:
  void on_unit(const StudyUnit& unit, const StudySums& sums);
  void on_point(const StudyPointResult& result);
  void write_tables() const;
  void show_progress(bool last);

  using Clock = std::chrono::steady_clock;
  const Study& study_;
  StudyJob job_;
  std::optional<WriteLock> lock_;  ///< shards share it, each has its journal to itself
  std::unique_ptr<JournalReader> known_;
  std::unique_ptr<JournalWriter> journal_;
  std::map<int, std::string> results_, timing_;  ///< rows of the points complete
  Clock::time_point begin_ = Clock::now(), written_{}, shown_{};
  long repeats_run_ = 0, repeats_known_ = 0, repeats_asked_ = 0;
  bool terminal_ = false;
};

/// What a run writes into its folder: results.csv, timing.csv and its journal.
std::vector<std::string> result_files(const StudyJob& job);

/// Loads the study and checks the job. Throws InputError.
Study study_of(StudyJob& job);

}  // namespace rangecal::app
