// SPDX-License-Identifier: BSD-3-Clause
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal {

std::string dropped_in_words(const Counts& counts) {
  std::vector<std::pair<std::string, int>> reasons;
  for (const auto& reason : counts.dropped)
    if (reason.second > 0) reasons.push_back(reason);
  std::stable_sort(reasons.begin(), reasons.end(),
                   [](const auto& a, const auto& b) { return a.second > b.second; });
  std::string text;
  for (const auto& [reason, count] : reasons)
    text += (text.empty() ? "" : ", ") + std::to_string(count) + " " + reason;
  return text;
}

}  // namespace rangecal
