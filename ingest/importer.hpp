// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <CLI/CLI.hpp>
#include <functional>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal::ingest {

/// What an importer made of a data set.
struct Imported {
  Recording recording;
  std::string words;                     ///< what was read and what was left out, for people
  std::string extraction_json;           ///< of raw scans: extraction.json (extraction_text.hpp); else empty
  std::vector<std::string> inputs = {};  ///< the files that were read
  std::vector<std::string> warnings = {};  ///< what speaks against the result, for stderr
};

/// A published data set, or a table of a known form, that becomes a recording. Adding one is adding a file to this folder with
///   const bool kKnown = know_importer({"name", "what it reads", add});
/// where `add` declares the options of `rangecal import name`, the output's excepted, and returns what imports by them
/// once they are parsed. The same options are the arguments of rangecal.import_dataset in Python.
struct Importer {
  std::string name, what;
  std::function<std::function<Imported()>(CLI::App& command)> add;
};

/// Registers an importer before main() begins; returns true.
bool know_importer(Importer importer);
/// Every importer, by name.
const std::vector<Importer>& importers();

/// A file of whitespace separated words, one record a line; lines that begin with # and blank lines are skipped.
class WordTable {
 public:
  explicit WordTable(const std::string& path);
  std::size_t rows() const { return rows_.size(); }
  std::size_t words(std::size_t row) const { return rows_[row].size(); }
  const std::string& text(std::size_t row, std::size_t word) const;
  double number(std::size_t row, std::size_t word) const;  ///< finite; throws InputError naming file and row
  int whole(std::size_t row, std::size_t word) const;      ///< the same, and a whole number that an int holds
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::vector<std::vector<std::string>> rows_;
  std::vector<int> lines_;
};

}  // namespace rangecal::ingest
