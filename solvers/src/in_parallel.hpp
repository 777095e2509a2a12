// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <cstddef>

namespace rangecal {

/// Calls f(i) for i in 0 .. count - 1 on the cores there are. Every call writes to places of its own, so that
/// the answer has the same bits on any number of them. A thread that waits for the last call takes up nothing
/// that is not part of it: where many recordings are worked on at once, none is held up by another.
template <typename F>
void in_parallel(std::size_t count, const F& f) {
  if (count == 0) return;
  if (count == 1) return f(std::size_t{0});
  tbb::this_task_arena::isolate([&] { tbb::parallel_for(std::size_t{0}, count, f); });
}

}  // namespace rangecal
