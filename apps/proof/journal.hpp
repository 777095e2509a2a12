// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>
#include <tuple>
#include <vector>

#include "rangecal/core/descriptor.hpp"
#include "scoring.hpp"

namespace rangecal::proof {

/// One line per world, under a header.
std::string proof_csv(const std::vector<Score>& scores);

/// The scores of such a text; a last line that was cut short is left out. `name` stands for the file in
/// messages.
std::vector<Score> read_scores(std::string text, const std::string& name);

/// Worlds by row, design and number.
using ScoreKey = std::tuple<std::string, std::string, int>;
inline ScoreKey key_of(const Score& score) { return {score.row, score.design, score.index}; }

/// Scores on disk as they come, so that a proof that is stopped goes on where it was. When it is whole the
/// file is replaced by one in the order of the rows.
class Journal {
 public:
  /// Opens `path`; `known` scores of an earlier run are kept. Throws InputError if it cannot be written.
  Journal(const std::string& path, const std::vector<Score>& known);
  /// A line that a full disk cuts short is taken back, and InputError thrown.
  void append(const Score& score);
  void finish(const std::vector<Score>& scores);

 private:
  std::string path_;
  Descriptor file_;
};

}  // namespace rangecal::proof
