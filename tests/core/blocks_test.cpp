// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/blocks.hpp"

#include <gtest/gtest.h>

#include <string>

#include "rangecal/core/recording_io.hpp"

namespace rangecal {
namespace {

Recording pairs_of(const std::string& table, const std::string& header = "") {
  return parse_recording(
      {{"recording.yaml", "format: rangecal/1\nkind: pairs\n" + header}, {"pairs.csv", table}});
}

/// "true_m,reading_m,EXTRA" with a row for each i, its true distance and what else it has.
template <typename Distance, typename Extra>
std::string table(const std::string& columns, int rows, const Distance& distance, const Extra& extra) {
  std::string text = "true_m,reading_m" + columns + "\n";
  for (int i = 0; i < rows; ++i) text += std::to_string(distance(i)) + ",1" + extra(i) + "\n";
  return text;
}

const auto nothing = [](int) { return std::string(); };
const auto ascending = [](int i) { return 1.0 + 0.01 * i; };

TEST(Blocks, GroupsThatAreStatedComeFirst) {
  const Recording r =
      pairs_of(table(",batch,trial", 6, ascending,
                     [](int i) { return ",b" + std::to_string(i) + (i % 2 ? ",odd" : ",even"); }),
               "group_by: [trial]\n");
  const Blocks blocks = blocks_of(r);
  EXPECT_EQ(blocks.kind, BlockKind::groups);
  EXPECT_EQ(blocks.of, (std::vector<int>{0, 1, 0, 1, 0, 1}));
  EXPECT_EQ(blocks_in_words(blocks.kind, r.groups), "groups of trial");
}

TEST(Blocks, ThenBatchesWhereThereAreFive) {
  const auto batches_of = [](int count) {
    return blocks_of(
        pairs_of(table(",batch", 20, ascending, [=](int i) { return "," + std::to_string(i % count); })));
  };
  EXPECT_EQ(batches_of(5).kind, BlockKind::batches);
  EXPECT_EQ(batches_of(5).of[7], 2);
  EXPECT_EQ(batches_of(4).kind, BlockKind::stretches);
}

TEST(Blocks, AReadingInNoBatchIsABlockOfItsOwn) {
  const Blocks blocks = blocks_of(pairs_of(
      table(",batch", 8, ascending, [](int i) { return i < 4 ? ",b" + std::to_string(i / 2) : ","; })));
  EXPECT_EQ(blocks.kind, BlockKind::batches);
  EXPECT_EQ(blocks.of, (std::vector<int>{0, 0, 1, 1, 2, 3, 4, 5}));
}

TEST(Blocks, ThenDistancesThatRepeat) {
  const auto cycling = [](int i) { return 1.0 + i % 6; };
  const Blocks blocks = blocks_of(pairs_of(table("", 18, cycling, nothing)));
  EXPECT_EQ(blocks.kind, BlockKind::distances);
  EXPECT_EQ(blocks.of[0], blocks.of[6]);
  EXPECT_EQ(blocks_of(pairs_of(table("", 17, cycling, nothing))).kind, BlockKind::stretches);  // not thrice
}

TEST(Blocks, ElseStretchesOfTime) {
  // 50 readings, the later in time the earlier in the file: two to each of 25 stretches, numbered as they come.
  const Blocks blocks = blocks_of(
      pairs_of(table(",time_s", 50, ascending, [](int i) { return "," + std::to_string(100 - i); })));
  EXPECT_EQ(blocks.kind, BlockKind::stretches);
  EXPECT_EQ(blocks.of.front(), 0);
  EXPECT_EQ(blocks.of[1], 0);
  EXPECT_EQ(blocks.of[2], 1);
  EXPECT_EQ(blocks.of.back(), 24);
}

TEST(Blocks, WithoutTimesStretchesStayWithinADevice) {
  // Two devices in turn, 50 readings each: no stretch of 4 readings holds both.
  const Recording r =
      pairs_of(table(",landmark", 100, ascending, [](int i) { return i % 2 ? ",right" : ",left"; }));
  const Blocks blocks = blocks_of(r);
  for (std::size_t i = 0; i + 1 < 100; i += 2) EXPECT_NE(blocks.of[i], blocks.of[i + 1]) << i;
  EXPECT_EQ(blocks.of[0], blocks.of[2]);
}

TEST(Blocks, OfLandmarksStopsThoseOfOnePlaceTogether) {
  const Recording r = parse_recording(
      {{"recording.yaml", "format: rangecal/1\n"},
       {"stops.csv", "stop,x_m,y_m,heading_rad,place\n0,0,0,0,p\n1,0,0,1,p\n2,1,0,0,\n"},
       {"observations.csv", "stop,landmark,range_m,bearing_rad\n0,A,1,0\n1,A,1,0\n2,A,1,0\n2,B,1,0\n"}});
  const Blocks blocks = blocks_of(r);
  EXPECT_EQ(blocks.kind, BlockKind::stops);
  EXPECT_EQ(blocks.of, (std::vector<int>{0, 0, 1, 1}));
}

TEST(Blocks, EffectiveNumber) {
  EXPECT_DOUBLE_EQ(effective_blocks({0, 0, 1, 1, 2, 2}), 3.0);
  EXPECT_DOUBLE_EQ(effective_blocks({0, 0, 0, 1}), 1.6);  // 4^2 / (3^2 + 1^2)
  EXPECT_DOUBLE_EQ(effective_blocks({}), 0.0);
}

}  // namespace
}  // namespace rangecal
