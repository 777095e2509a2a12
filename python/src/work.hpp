// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

#include <functional>
#include <memory>
#include <optional>
#include <string>

namespace rangecal::python {

namespace py = pybind11;

/// Told by the work what begins and which fraction is done; throws to end work that nobody waits for any
/// more.
using StageHook = std::function<void(const std::string& stage, double fraction)>;

/// Runs the work on a thread of its own with the GIL released. The calling thread watches for signals and
/// hands stages to `progress(stage, fraction)` unless that is None. A signal (Ctrl-C) or an exception of
/// `progress` is raised within 50 ms; the work then ends by itself at its next stage, and at the latest
/// before the interpreter does; its thread is joined by the next call. What the work captures must not be Python objects.
void run_interruptible(std::function<void(const StageHook&)> work, const py::object& progress);

/// The same for work with a result.
template <typename Result>
Result run_interruptible(std::function<Result(const StageHook&)> work, const py::object& progress) {
  const auto result = std::make_shared<std::optional<Result>>();
  run_interruptible([result, work = std::move(work)](const StageHook& hook) { *result = work(hook); },
                    progress);
  return std::move(**result);
}

/// Joins the threads of interrupted work. Called before the interpreter ends.
void join_leftovers();

}  // namespace rangecal::python
