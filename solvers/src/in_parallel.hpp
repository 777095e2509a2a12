// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <tbb/parallel_for.h>
#include <tbb/task_arena.h>

#include <algorithm>
#include <cstddef>
#include <utility>

namespace rangecal {

/// How many jobs that each hold some dozens of numbers for every reading may run at once: about a gigabyte.
inline std::size_t jobs_at_once(std::size_t readings) {
  return std::clamp<std::size_t>(8000000 / std::max<std::size_t>(readings, 1), 1, 64);
}

/// True on a thread while it works on a call of `in_parallel`.
inline thread_local bool is_in_parallel = false;

/// Calls f(i) for i in 0 .. count - 1 on the cores there are, `at_once` of them at a time at most. Every call
/// writes to places of its own, so that the answer has the same bits on any number of cores. A thread that
/// waits for the last call takes up nothing that is not part of it, calls inside f being part of it too: where many recordings
/// are worked on at once, none is held up by another, and where one of them fails, what the others were at is not left half
/// done.
template <typename F>
void in_parallel(std::size_t count, const F& f, std::size_t at_once = 64) {
  if (count == 1 || at_once == 1) {
    for (std::size_t i = 0; i < count; ++i) f(i);
    return;
  }
  struct Inside {
    bool before = std::exchange(is_in_parallel, true);
    ~Inside() { is_in_parallel = before; }
  };
  const auto all = [&] {
    for (std::size_t begin = 0; begin < count; begin += at_once) {
      tbb::task_group_context own(tbb::task_group_context::isolated);
      tbb::parallel_for(
          begin, std::min(count, begin + at_once),
          [&f](std::size_t i) {
            const Inside inside;
            f(i);
          },
          own);
    }
  };
  if (is_in_parallel)
    all();
  else
    tbb::this_task_arena::isolate(all);
}

}  // namespace rangecal
