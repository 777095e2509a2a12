// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/seen_landmarks.hpp"

namespace rangecal {
namespace {

/// Per landmark; all of those of pairs, which have no observations.
std::vector<char> seen_of(const Recording& recording) {
  std::vector<char> seen(recording.landmarks.size(), recording.kind == RecordingKind::pairs);
  for (int l : recording.readings.landmark) seen[static_cast<std::size_t>(l)] = 1;
  return seen;
}

Recording seen_part(const Recording& whole) {
  const std::vector<char> seen = seen_of(whole);
  Recording part = whole;
  part.landmarks.clear();
  part.truth.landmarks.clear();
  std::vector<int> renumbered(seen.size(), -1);
  for (std::size_t l = 0; l < seen.size(); ++l) {
    if (!seen[l]) continue;
    renumbered[l] = static_cast<int>(part.landmarks.size());
    part.landmarks.push_back(whole.landmarks[l]);
    if (l < whole.truth.landmarks.size()) part.truth.landmarks.push_back(whole.truth.landmarks[l]);
  }
  for (int& l : part.readings.landmark) l = renumbered[static_cast<std::size_t>(l)];
  part.known_distances.clear();
  for (KnownDistance taped : whole.known_distances) {
    taped.from = renumbered[static_cast<std::size_t>(taped.from)];
    taped.to = renumbered[static_cast<std::size_t>(taped.to)];
    if (taped.from >= 0 && taped.to >= 0) part.known_distances.push_back(taped);
  }
  return part;
}

}  // namespace

std::vector<std::string> unseen_landmarks(std::span<const Recording> recordings) {
  std::vector<std::string> labels;
  for (const Recording& recording : recordings) {
    const std::vector<char> seen = seen_of(recording);
    for (std::size_t l = 0; l < seen.size(); ++l)
      if (!seen[l]) labels.push_back(recording.landmarks[l].label);
  }
  return labels;
}

std::vector<Recording> with_seen_landmarks(std::span<const Recording> recordings) {
  std::vector<Recording> parts;
  for (const Recording& recording : recordings) parts.push_back(seen_part(recording));
  return parts;
}

}  // namespace rangecal
