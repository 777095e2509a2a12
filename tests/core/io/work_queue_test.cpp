// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/work_queue.hpp"

#include <gtest/gtest.h>
#include <signal.h>
#include <sys/wait.h>
#include <unistd.h>

#include <atomic>
#include <chrono>
#include <filesystem>
#include <fstream>
#include <set>
#include <thread>
#include <vector>

#include "rangecal/core/errors.hpp"
#include "support/temporary_folder.hpp"

namespace rangecal {
namespace {

using test::TemporaryFolder;
using namespace std::chrono_literals;

// Queues of one process are strangers to each other like those of several.
TEST(WorkQueue, EveryUnitIsTakenOnce) {
  const TemporaryFolder folder;
  constexpr int units = 10000, workers = 8;  // more than a stretch of the table
  std::vector<std::atomic<int>> done(units);
  std::atomic<int> finished{0};
  std::vector<std::thread> threads;
  WorkQueue first(folder.file("queue"), units, 7);
  for (int w = 0; w < workers; ++w)
    threads.emplace_back([&, w] {
      auto queue = WorkQueue::join(folder.file("queue"), units, 7);
      ASSERT_TRUE(queue);
      for (auto taken = queue->take(w + 1); !taken.empty(); taken = queue->take(w + 1)) {
        for (const std::int64_t unit : taken) ++done[static_cast<std::size_t>(unit)];
        queue->done(taken);
      }
      if (queue->finishes()) ++finished, queue->finished();
    });
  for (std::thread& thread : threads) thread.join();
  for (const auto& one : done) EXPECT_EQ(one, 1);
  EXPECT_EQ(finished, 1);
  EXPECT_FALSE(std::filesystem::exists(folder.file("queue")));
  EXPECT_FALSE(WorkQueue::join(folder.file("queue"), units, 7));  // who comes too late finds that all is done
  EXPECT_TRUE(first.take(1).empty());
  EXPECT_FALSE(first.finishes());
}

/// A process that takes units, keeps one of them as done, and is killed.
pid_t holder(const std::string& path, std::int64_t units, std::size_t takes) {
  const pid_t child = ::fork();
  if (child == 0) {
    WorkQueue queue(path, units, 1);
    const auto taken = queue.take(takes);
    queue.done({taken.front()});
    std::ofstream(path + ".holds");
    ::pause();
    ::_exit(0);
  }
  while (!std::filesystem::exists(path + ".holds")) std::this_thread::sleep_for(1ms);
  std::filesystem::remove(path + ".holds");
  return child;
}
void kill_and_wait(pid_t child) {
  ::kill(child, SIGKILL);
  int status = 0;
  ::waitpid(child, &status, 0);
}

TEST(WorkQueue, UnitsOfAProcessThatDiedGoToTheOthers) {
  const TemporaryFolder folder;
  const pid_t child = holder(folder.file("queue"), 10, 4);
  WorkQueue queue(folder.file("queue"), 10, 1);
  std::set<std::int64_t> mine;
  const auto take = [&] {
    const auto taken = queue.take(1);
    mine.insert(taken.begin(), taken.end());
    queue.done(taken);
    return !taken.empty();
  };
  for (int i = 0; i < 6; ++i) ASSERT_TRUE(take());
  EXPECT_EQ(mine.size(), 6u);  // the others are held, or done
  std::thread waits([&] {
    while (take()) {
    }
  });
  std::this_thread::sleep_for(50ms);
  kill_and_wait(child);
  waits.join();
  EXPECT_EQ(mine.size(), 9u);  // all but the one that it had done
}

TEST(WorkQueue, AnotherFinishesWhereTheFirstDied) {
  const TemporaryFolder folder;
  const std::string path = folder.file("queue");
  const pid_t child = ::fork();
  if (child == 0) {
    WorkQueue queue(path, 1, 1);
    queue.done(queue.take(1));
    if (queue.finishes()) std::ofstream(path + ".holds");
    ::pause();
    ::_exit(0);
  }
  while (!std::filesystem::exists(path + ".holds")) std::this_thread::sleep_for(1ms);
  WorkQueue queue(path, 1, 1);
  EXPECT_TRUE(queue.take(1).empty());
  std::atomic<bool> answered{false};
  std::thread waits([&] {
    EXPECT_TRUE(queue.finishes());
    answered = true;
  });
  std::this_thread::sleep_for(50ms);
  EXPECT_FALSE(answered);
  kill_and_wait(child);
  waits.join();
}

TEST(WorkQueue, WhatIsDoneStaysAndOtherWorkBeginsAnew) {
  const TemporaryFolder folder;
  {
    WorkQueue queue(folder.file("queue"), 3, 1);
    queue.done(queue.take(2));
  }
  {
    WorkQueue again(folder.file("queue"), 3, 1);
    EXPECT_EQ(again.take(9).size(), 1u);
    EXPECT_THROW(WorkQueue(folder.file("queue"), 3, 2), InputError);  // it is used
    EXPECT_THROW(WorkQueue(folder.file("queue"), 4, 1), InputError);
  }
  WorkQueue other(folder.file("queue"), 3, 2);
  EXPECT_EQ(other.take(9).size(), 3u);
  EXPECT_THROW(WorkQueue(folder.file("none/queue"), 3, 2), InputError);
}

TEST(WorkQueue, OfNoUnitsAllAreDone) {
  const TemporaryFolder folder;
  WorkQueue queue(folder.file("queue"), 0, 1);
  EXPECT_TRUE(queue.take(1).empty());
  EXPECT_TRUE(queue.finishes());
}

}  // namespace
}  // namespace rangecal
