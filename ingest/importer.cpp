// SPDX-License-Identifier: BSD-3-Clause
#include "importer.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <limits>
#include <sstream>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/files.hpp"

namespace rangecal::ingest {
namespace {

std::vector<Importer>& list() {
  static std::vector<Importer> known;
  return known;
}

}  // namespace

bool know_importer(Importer importer) {
  std::vector<Importer>& known = list();
  const auto behind = [&](const Importer& other) { return importer.name < other.name; };
  known.insert(std::find_if(known.begin(), known.end(), behind), std::move(importer));
  return true;
}

const std::vector<Importer>& importers() { return list(); }

WordTable::WordTable(const std::string& path) : path_(path) {
  std::istringstream lines(read_file(path, std::size_t{64} << 20));
  std::string line;
  for (int number = 1; std::getline(lines, line); ++number) {
    std::istringstream stream(line);
    std::vector<std::string> words;
    for (std::string word; stream >> word;) words.push_back(word);
    if (words.empty() || words.front().front() == '#') continue;
    rows_.push_back(std::move(words));
    lines_.push_back(number);
  }
  if (rows_.empty()) throw InputError(path, 0, "", "holds no record");
}

const std::string& WordTable::text(std::size_t row, std::size_t word) const {
  if (word >= rows_[row].size())
    throw InputError(path_, lines_[row], "",
                     "holds " + std::to_string(rows_[row].size()) + " words, at least " +
                         std::to_string(word + 1) + " are needed");
  return rows_[row][word];
}

double WordTable::number(std::size_t row, std::size_t word) const {
  const std::string& field = text(row, word);
  double value = 0.0;
  const auto [end, code] = std::from_chars(field.data(), field.data() + field.size(), value);
  if (code != std::errc() || end != field.data() + field.size() || !std::isfinite(value))
    throw InputError(
        path_, lines_[row], "",
        "word " + std::to_string(word + 1) + ", '" + field.substr(0, 40) + "', is not a finite number");
  return value;
}

int WordTable::whole(std::size_t row, std::size_t word) const {
  const double value = number(row, word);
  if (value != std::floor(value) || std::abs(value) > std::numeric_limits<int>::max())
    throw InputError(path_, lines_[row], "",
                     "word " + std::to_string(word + 1) + ", '" + text(row, word).substr(0, 40) +
                         "', is not a whole number");
  return static_cast<int>(value);
}

}  // namespace rangecal::ingest
