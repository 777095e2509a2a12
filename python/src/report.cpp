// SPDX-License-Identifier: BSD-3-Clause
#include "report/report.hpp"

#include <pybind11/stl.h>

#include "comparison.hpp"
#include "ingest/bags/diagnosis_mcap.hpp"
#include "job_result.hpp"
#include "module.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/files.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

/// Writes the page that `make` makes, on a thread that Ctrl-C leaves.
void write_page(const std::string& path, const std::function<std::string()>& make) {
  report::require_available();
  require_writable(path);
  write_file(path, run_interruptible<std::string>([make](const StageHook&) { return make(); }, py::none()));
}

using Given = std::vector<std::shared_ptr<Recording>>;

Recordings recordings_of(const Given& given) { return Recordings({given.begin(), given.end()}); }

void report_calibration(const std::shared_ptr<JobResult>& job, std::size_t index, const Given& recordings,
                        const std::string& path) {
  const Recordings all = recordings_of(recordings);
  write_page(path, [job, index, all] {
    return report::calibration_page(all.span(), job->report, job->report.calibrations.at(index));
  });
}

void report_comparison(const std::shared_ptr<JobResult>& job, const Given& recordings,
                       const std::string& path) {
  const Recordings all = recordings_of(recordings);
  write_page(path, [job, all] {
    return report::comparison_page(all.span(), job->report, job->scores,
                                   app::advise(job->report, all.span(), job->scores));
  });
}

void report_diagnosis(const std::shared_ptr<Diagnosis>& diagnosis, const Given& recordings,
                      const std::string& path) {
  const Recordings all = recordings_of(recordings);
  write_page(path, [diagnosis, all] { return report::diagnosis_page(all.span(), *diagnosis); });
}

void mcap_diagnosis(const std::shared_ptr<Diagnosis>& diagnosis, const Given& recordings,
                    const std::string& path) {
  const Recordings all = recordings_of(recordings);
  require_place_for_file(path);
  run_interruptible<bool>(
      [diagnosis, all, path](const StageHook&) {
        ingest::write_diagnosis_mcap(all.span(), *diagnosis, path);
        return true;
      },
      py::none());
}

std::string calibration_summary(const std::shared_ptr<JobResult>& job, std::size_t index,
                                const Given& recordings) {
  return report::calibration_summary(recordings_of(recordings).span(), job->report,
                                     job->report.calibrations.at(index));
}

std::string comparison_summary(const std::shared_ptr<JobResult>& job, const Given& recordings) {
  return report::comparison_summary(recordings_of(recordings).span(), job->report, job->scores);
}

void report_study(const std::string& name, const std::string& results_csv, const std::string& path) {
  write_page(path,
             [name, results_csv] { return report::study_page(name, CsvTable::parse(results_csv, name)); });
}

}  // namespace

void bind_report(py::module_& module) {
  const auto job = py::arg("job").none(false);
  const py::arg index("index"), recordings("recordings"), path("path");
  module.def("report_calibration", &report_calibration, job, index, recordings, path);
  module.def("report_comparison", &report_comparison, job, recordings, path);
  module.def("report_diagnosis", &report_diagnosis, py::arg("diagnosis").none(false), recordings, path);
  module.def("mcap_diagnosis", &mcap_diagnosis, py::arg("diagnosis").none(false), recordings, path);
  module.def("report_study", &report_study);
  module.def("diagnosis_summary", &report::diagnosis_summary);
  module.def("calibration_summary", &calibration_summary, job, index, recordings);
  module.def("comparison_summary", &comparison_summary, job, recordings);
}

}  // namespace rangecal::python
