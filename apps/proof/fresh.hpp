// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

#include "everyday.hpp"
#include "rows.hpp"
#include "scoring.hpp"

namespace rangecal::proof {

struct FreshOptions {
  int worlds = 300;  ///< per row; clean worlds 5/3 of it per design
  std::uint64_t seed = 0;
  std::string design = "both";    ///< "line", "turning", "both" (by turns)
  std::vector<std::string> rows;  ///< names of row_names(); empty: all
  bool oracle = true;             ///< refit the true effect too, for the gain
  std::vector<Score> known;       ///< worlds of the same seed that were scored before: they are not run again
  std::function<void(int done, int all)> progress;
  std::function<void(const Score&)> scored;  ///< each world as it is done, one at a time
};

struct FreshResult {
  std::vector<Score> scores;                ///< in the order of row, index
  std::map<std::string, int> out_of_reach;  ///< effects that were drawn and cannot reach the target
};

/// Table number `index` of the row `everyday`.
EverydayTable everyday_table(std::uint64_t seed, int index, const std::string& design);

/// Fills in the gain in NLL over that of the true effects, refitted on the same recording.
void add_gain(Score& score, const Case& the_case, const Recording& recording, const Diagnosis& diagnosis,
              const Diagnose& diagnose);

/// One world from drawing to score. Cost: one to three diagnoses.
Score run_case(const std::string& row, std::uint64_t seed, int index, const std::string& design, bool oracle,
               const Diagnose& diagnose, std::vector<std::string>* out_of_reach = nullptr);

/// Draws worlds that nobody has seen, has them diagnosed and scores the answers. Worlds run in parallel, except those
/// for speed; results do not depend on how. A diagnosis that throws is scored as an answer that is missing.
FreshResult run_fresh(const FreshOptions& options, const Diagnose& diagnose);

}  // namespace rangecal::proof
