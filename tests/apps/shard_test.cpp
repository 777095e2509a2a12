// SPDX-License-Identifier: BSD-3-Clause
#include "shard.hpp"

#include <gtest/gtest.h>

namespace rangecal::app {
namespace {

TEST(Shard, IsOneOfSeveral) {
  EXPECT_EQ(shard_from("2/8").index, 1);
  EXPECT_EQ(shard_from("2/8").count, 8);
  EXPECT_EQ(shard_from("8/8").index, 7);
  EXPECT_EQ(shard_from("").count, 1);
  EXPECT_EQ(shard_from("2147483647/2147483647").index, 2147483646);
}

TEST(Shard, AnythingElseIsRefused) {
  for (const char* text :
       {"0/8", "9/8", "-1/8", "1/-8", "1", "1/", "/8", "/", "1/8/", "1/8 ", " 1/8", "1/ 8", " 1/ 8", "+1/8",
        "1.0/8", "one/8", "4294967297/4294967298", "1/99999999999999999999"}) {
    SCOPED_TRACE(text);
    try {
      shard_from(text);
      ADD_FAILURE() << "accepted";
    } catch (const InputError& error) {
      EXPECT_EQ(error.what(), std::string("--shard ") + text + ": is not I/N with 1 <= I <= N");
    }
  }
}

}  // namespace
}  // namespace rangecal::app
