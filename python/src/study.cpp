// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>

#include <map>
#include <optional>
#include <tuple>

#include "module.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/study/run.hpp"
#include "rangecal/solvers/study/table.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

/// Its name, and its tables as CSV: of results, of processor times.
using Tables = std::tuple<std::string, std::string, std::string>;

Tables run(const Study& study, int threads, const StageHook& hook) {
  const long units = static_cast<long>(study.points.size()) * study_pieces(study);
  long done = 0;
  std::map<int, std::string> results, timing;  // by point: they complete in any order
  StudyOptions options;
  options.threads = threads;
  options.on_unit = [&](const StudyUnit& unit, const StudySums&) {
    ++done;
    hook(study.points[static_cast<std::size_t>(unit.point)].key,
         static_cast<double>(done) / static_cast<double>(units));
  };
  options.on_point = [&](const StudyPointResult& point) {
    results[point.point] = study_csv_rows(study, point);
    timing[point.point] = timing_csv_rows(study, point);
  };
  run_study(study, options);
  Tables tables{study.name, study_csv_header(study), timing_csv_header(study)};
  for (const auto& [point, rows] : results) std::get<1>(tables) += rows;
  for (const auto& [point, rows] : timing) std::get<2>(tables) += rows;
  return tables;
}

Tables study_job(const std::string& path, const std::optional<int>& repeats, int threads,
                 const py::object& progress) {
  Study study = load_study(path);
  if (repeats && *repeats < 1)
    throw InputError("repeats is " + std::to_string(*repeats) + ", not at least 1");
  if (threads < 0) throw InputError("threads is " + std::to_string(threads) + ", not at least 0");
  if (repeats) study.repeats = *repeats;
  return run_interruptible<Tables>(
      [study, threads](const StageHook& hook) { return run(study, threads, hook); }, progress);
}

}  // namespace

void bind_study(py::module_& module) {
  module.def("study_job", &study_job, py::arg("path"), py::arg("repeats"), py::arg("threads"),
             py::arg("progress"));
}

}  // namespace rangecal::python
