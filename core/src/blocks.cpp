// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/blocks.hpp"

#include <algorithm>
#include <map>
#include <numeric>
#include <set>
#include <utility>

namespace rangecal {
namespace {

constexpr std::size_t fewest_settings =
    5;  ///< fewer cannot be left out one by one: the curve would be extrapolated
constexpr std::size_t stretches = 25;

/// Numbers keys as they come.
template <typename Key>
class Numbered {
 public:
  int operator()(const Key& key) {
    return number_.emplace(key, static_cast<int>(number_.size())).first->second;
  }
  std::size_t size() const { return number_.size(); }

 private:
  std::map<Key, int> number_;
};

std::vector<int> by_place(const Recording& recording) {
  Numbered<std::string> places;
  Numbered<std::pair<int, int>> number;  // (place, stop): stops without a place are places of their own
  std::vector<int> block;
  for (const int stop : recording.readings.stop) {
    const std::string& place = recording.stops[static_cast<std::size_t>(stop)].place;
    block.push_back(number(place.empty() ? std::pair{-1, stop} : std::pair{places(place), -1}));
  }
  return block;
}

/// A reading in no batch is a block of its own.
std::vector<int> by_batch(const Pairs& pairs) {
  Numbered<std::pair<int, std::size_t>> number;
  std::vector<int> block;
  for (std::size_t i = 0; i < pairs.batch.size(); ++i)
    block.push_back(number({pairs.batch[i], pairs.batch[i] < 0 ? i : 0}));
  return block;
}

std::vector<int> by_stretch(const Pairs& pairs) {
  const std::size_t count = pairs.size();
  std::vector<std::size_t> order(count);
  std::iota(order.begin(), order.end(), std::size_t{0});
  const auto key = [&](std::size_t i) {
    return std::pair{pairs.time_s.empty() ? 0.0 : pairs.time_s[i],
                     !pairs.time_s.empty() || pairs.landmark.empty() ? 0 : pairs.landmark[i]};
  };
  std::stable_sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) { return key(a) < key(b); });
  std::vector<int> stretch(count), block;
  for (std::size_t rank = 0; rank < count; ++rank)
    stretch[order[rank]] = static_cast<int>(rank * std::min(stretches, count) / count);
  Numbered<int> number;
  for (const int one : stretch) block.push_back(number(one));
  return block;
}

}  // namespace

Blocks blocks_of(const Recording& recording) {
  if (recording.groups.stated()) return {BlockKind::groups, recording.groups.of};
  if (recording.kind == RecordingKind::landmarks) return {BlockKind::stops, by_place(recording)};
  const Pairs& pairs = recording.pairs;
  if (!pairs.batch.empty()) {
    std::vector<int> block = by_batch(pairs);
    if (*std::max_element(block.begin(), block.end()) + 1 >= static_cast<int>(fewest_settings))
      return {BlockKind::batches, std::move(block)};
    return {BlockKind::stretches, by_stretch(pairs)};
  }
  Numbered<double> distances;
  std::vector<int> block;
  for (const double d : pairs.true_m) block.push_back(distances(d));
  if (distances.size() >= fewest_settings && distances.size() <= pairs.size() / 3)
    return {BlockKind::distances, std::move(block)};
  return {BlockKind::stretches, by_stretch(pairs)};
}

BlocksOfAll blocks_of_all(std::span<const Recording> recordings) {
  BlocksOfAll all;
  std::set<std::string> kinds;
  int first = 0;
  for (const Recording& recording : recordings) {
    const Blocks own = blocks_of(recording);
    for (const int block : own.of) all.of.push_back(first + block);
    if (!own.of.empty()) first += 1 + *std::max_element(own.of.begin(), own.of.end());
    kinds.insert(blocks_in_words(own.kind, recording.groups));
  }
  for (const std::string& kind : kinds) all.words += (all.words.empty() ? "" : ", ") + kind;
  return all;
}

double effective_blocks(const std::vector<int>& block_of_reading) {
  std::map<int, double> readings;
  for (const int block : block_of_reading) readings[block] += 1.0;
  double sum = 0.0, squares = 0.0;
  for (const auto& [block, count] : readings) {
    sum += count;
    squares += count * count;
  }
  return squares > 0.0 ? sum * sum / squares : 0.0;
}

std::string blocks_in_words(BlockKind kind, const Groups& groups) {
  switch (kind) {
    case BlockKind::groups: {
      std::string words = "groups of ";
      for (std::size_t i = 0; i < groups.by.size(); ++i) words += (i == 0 ? "" : " and ") + groups.by[i];
      return words;
    }
    case BlockKind::batches:
      return "batches";
    case BlockKind::distances:
      return "distances";
    case BlockKind::stops:
      return "stops";
    case BlockKind::stretches:
      break;
  }
  return "stretches";
}

}  // namespace rangecal
