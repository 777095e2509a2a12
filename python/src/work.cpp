// SPDX-License-Identifier: BSD-3-Clause
#include "work.hpp"

#include <chrono>
#include <condition_variable>
#include <exception>
#include <list>
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

std::list<std::thread>& leftovers() {
  static std::list<std::thread> threads;  // guarded by the GIL
  return threads;
}

}  // namespace

void run_interruptible(std::function<void(const StageHook&)> work, const py::object& progress) {
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
    leftovers().push_back(std::move(thread));
    throw;
  }
  thread.join();
  if (job->error) std::rethrow_exception(job->error);
}

void join_leftovers() {
  std::list<std::thread> threads = std::move(leftovers());
  leftovers().clear();
  const py::gil_scoped_release release;
  for (std::thread& thread : threads) thread.join();
}

}  // namespace rangecal::python
