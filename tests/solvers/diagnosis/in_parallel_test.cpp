// SPDX-License-Identifier: BSD-3-Clause
#include "in_parallel.hpp"

#include <gtest/gtest.h>
#include <tbb/task.h>

#include <atomic>

namespace rangecal {
namespace {

TEST(InParallel, IsDoneWholeWhereWhatAskedForItIsCancelled) {
  // A recording that fails cancels the loop over recordings; the others are not left with half of their candidates.
  std::atomic<int> calls = 0;
  tbb::task_group_context outer;
  tbb::parallel_for(
      0, 1,
      [&](int) {
        tbb::task::current_context()->cancel_group_execution();
        in_parallel(64, [&](std::size_t) { ++calls; });
      },
      outer);
  EXPECT_EQ(calls, 64);
}

}  // namespace
}  // namespace rangecal
