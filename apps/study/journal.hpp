// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/descriptor.hpp"
#include "rangecal/solvers/study/run.hpp"

namespace rangecal::app {

/// A unit and its sums as one line of text that gives back the same bits, closed by a checksum of itself.
std::string journal_line(const StudyUnit& unit, const StudySums& sums);
/// None if the line is torn or damaged.
std::optional<std::pair<StudyUnit, StudySums>> from_journal_line(const std::string& line);

/// What is on disk of a study: every file DIR/journal*.txt of the folders given, each a header and one line per unit
/// finished. Holds 24 bytes per unit; the sums stay on disk until asked for.
class JournalReader {
 public:
  /// Throws InputError for a journal of another study, naming the file.
  JournalReader(const Study& study, const std::vector<std::string>& folders);

  bool knows(const StudyUnit& unit) const { return find(unit) != nullptr; }
  std::optional<StudySums> recall(const StudyUnit& unit) const;
  std::size_t units() const { return entries_.size(); }
  std::size_t files() const { return descriptors_.size(); }

 private:
  struct Entry {
    StudyUnit unit;
    int file = 0, length = 0;
    std::int64_t offset = 0;
  };
  const Entry* find(const StudyUnit& unit) const;
  void scan(const Study& study, const std::string& path);

  std::vector<Entry> entries_;  ///< ascending in unit
  std::vector<Descriptor> descriptors_;
};

/// Appends to one journal. One process at a time: a second one that tries throws InputError.
class JournalWriter {
 public:
  JournalWriter(const Study& study, const std::string& path);

  /// One write() of the whole line: a kill leaves it there, or torn at the end, where the reader drops it.
  void append(const StudyUnit& unit, const StudySums& sums);

 private:
  void write_all(const std::string& text);
  std::string path_;
  Descriptor descriptor_;
};

/// Whether a file of that name in a study's folder is read as a journal.
bool names_journal(const std::string& file);
/// Paths of the journals in a folder, sorted; none if there is no such folder.
std::vector<std::string> journals_in(const std::string& folder);

}  // namespace rangecal::app
