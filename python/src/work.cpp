// SPDX-License-Identifier: BSD-3-Clause
#include "work.hpp"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <iterator>
#include <list>
#include <memory>
#include <mutex>
#include <thread>
#include <utility>
#include <vector>

namespace rangecal::python {
namespace {

struct Interrupted : std::exception {};

struct Job {
  std::mutex mutex;
  std::condition_variable changed;
  std::vector<std::pair<std::string, double>> stages;  ///< not yet handed on
  bool done = false, interrupted = false;
  std::exception_ptr error;

  void report(const std::string& stage, double fraction) {
    const std::lock_guard lock(mutex);
    if (interrupted) throw Interrupted();
    stages.emplace_back(stage, fraction);
    changed.notify_all();
  }

  void run(const std::function<void(const StageHook&)>& work) {
    std::exception_ptr thrown;
    try {
      work([this](const std::string& stage, double fraction) { report(stage, fraction); });
    } catch (...) {
      thrown = std::current_exception();
    }
    const std::lock_guard lock(mutex);
    error = thrown;
    done = true;
    changed.notify_all();
  }
};

/// Interrupted work that may still run.
struct Leftover {
  std::shared_ptr<Job> job;
  std::thread thread;
};

std::list<Leftover>& leftovers() {
  static std::list<Leftover> all;  // guarded by the GIL
  return all;
}

void join_all(std::list<Leftover> ended) {
  if (ended.empty()) return;
  const py::gil_scoped_release release;
  for (Leftover& leftover : ended) leftover.thread.join();
}

/// Joins those that have come to their end since: each keeps its stack until then.
void join_ended() {
  std::list<Leftover> ended;
  for (auto at = leftovers().begin(); at != leftovers().end();) {
    const auto next = std::next(at);
    const std::lock_guard lock(at->job->mutex);
    if (at->job->done) ended.splice(ended.end(), leftovers(), at);
    at = next;
  }
  join_all(std::move(ended));
}

}  // namespace

void run_interruptible(std::function<void(const StageHook&)> work, const py::object& progress) {
  join_ended();
  const auto job = std::make_shared<Job>();
  std::thread thread([job, work = std::move(work)] { job->run(work); });
  try {
    for (bool done = false; !done;) {
      std::vector<std::pair<std::string, double>> stages;
      {
        const py::gil_scoped_release release;
        std::unique_lock lock(job->mutex);
        job->changed.wait_for(lock, std::chrono::milliseconds(50),
                              [&] { return job->done || !job->stages.empty(); });
        stages.swap(job->stages);
        done = job->done;
      }
      if (PyErr_CheckSignals() != 0) throw py::error_already_set();
      if (!progress.is_none())
        for (const auto& [stage, fraction] : stages) progress(stage, fraction);
    }
  } catch (...) {
    {
      const std::lock_guard lock(job->mutex);
      job->interrupted = true;
    }
    leftovers().push_back({job, std::move(thread)});
    throw;
  }
  thread.join();
  if (job->error) std::rethrow_exception(job->error);
}

void join_leftovers() { join_all(std::exchange(leftovers(), {})); }

}  // namespace rangecal::python
