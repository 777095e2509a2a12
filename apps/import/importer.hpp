// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <functional>
#include <string>
#include <vector>

#include "commands.hpp"

namespace rangecal::app {

/// A published data set that becomes a recording. Adding one is adding a file to this folder with
///   const bool kKnown = know_importer({"name", "what it reads", add});
/// where `add` declares the options of `rangecal import name` and sets `chosen`.
struct Importer {
  std::string name, what;
  std::function<void(CLI::App& command, Action& chosen)> add;
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
  const std::string& path() const { return path_; }

 private:
  std::string path_;
  std::vector<std::vector<std::string>> rows_;
  std::vector<int> lines_;
};

}  // namespace rangecal::app
