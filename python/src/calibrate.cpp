// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/solvers/calibrate.hpp"

#include <pybind11/stl.h>

#include <chrono>

#include "job_result.hpp"
#include "module.hpp"
#include "rangecal/solvers/calibrate/alpha_bound.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

CalibrateOptions options_from(const std::vector<std::string>& methods, const std::optional<int>& order,
                              const std::optional<std::string>& curve,
                              const std::optional<std::string>& noise, const std::string& noise_shape,
                              const std::string& solver, const std::string& weights, bool check,
                              const std::optional<Calibration>& from) {
  CalibrateOptions options;
  for (const std::string& method : methods) options.methods.push_back(method_from_string(method));
  options.order = order;
  if (curve) options.curve = curve_family_from_string(*curve);
  if (noise) options.noise = noise_law_from_string(*noise);
  options.noise_shape = noise_shape_from_string(noise_shape);
  options.solver = joint_solver_from_string(solver);
  options.weights = bearing_weights_from_string(weights);
  options.check = check;
  options.from = from;
  options.check_values();
  return options;
}

JobResult run(const Recordings& recordings, CalibrateOptions options, const StageHook& hook) {
  using Clock = std::chrono::steady_clock;
  std::map<Method, double> seconds;
  Clock::time_point begin;
  options.on_progress = [&](const std::string& stage) { hook(stage, 0.0); };
  options.on_method = [&](Method method, bool begins) {
    if (begins)
      begin = Clock::now();
    else
      seconds[method] = std::chrono::duration<double>(Clock::now() - begin).count();
  };
  JobResult result{calibrate_report(recordings.span(), options), {}};
  const Calibration* stops = nullptr;
  for (Calibration& c : result.report.calibrations) {
    c.seconds = seconds[c.method];
    if (is_usable(c.outcome) && !c.stops.empty()) stops = &c;
  }
  set_alpha_bounds(recordings.span(), result.report.calibrations);
  for (const Calibration& c : result.report.calibrations)
    result.scores.push_back(is_usable(c.outcome) && c.alpha.size() > 0
                                ? score_against_truth(recordings.span(), c, stops)
                                : TruthScore{});
  return result;
}

JobResult calibrate_job(std::vector<std::shared_ptr<Recording>> recordings,
                        const std::vector<std::string>& methods, const std::optional<int>& order,
                        const std::optional<std::string>& curve, const std::optional<std::string>& noise,
                        const std::string& noise_shape, const std::string& solver, const std::string& weights,
                        bool check, const std::optional<Calibration>& from, const py::object& progress) {
  CalibrateOptions options =
      options_from(methods, order, curve, noise, noise_shape, solver, weights, check, from);
  const Recordings job({recordings.begin(), recordings.end()});
  return run_interruptible<JobResult>(
      [job, options](const StageHook& hook) { return run(job, options, hook); }, progress);
}

}  // namespace

void bind_calibrate(py::module_& module) {
  py::class_<ModelScore>(module, "ModelScore")
      .def_readonly("order", &ModelScore::order)
      .def_property_readonly("noise_law", [](const ModelScore& m) { return to_string(m.law); })
      .def_property_readonly("curve", [](const ModelScore& m) { return to_string(m.family); })
      .def_readonly("nll", &ModelScore::nll)
      .def_readonly("aic", &ModelScore::aic)
      .def(picklable<ModelScore>());

  py::class_<CheckReport>(module, "CheckReport")
      .def_readonly("agrees", &CheckReport::agrees)
      .def_readonly("better_basin", &CheckReport::better_basin)
      .def_readonly("nll", &CheckReport::nll)
      .def_readonly("report", &CheckReport::report)
      .def(picklable<CheckReport>());

  py::class_<TruthScore>(module, "TruthScore")
      .def_readonly("landmark_rmse_m", &TruthScore::landmark_rmse_m)
      .def_readonly("landmarks", &TruthScore::landmarks)
      .def_readonly("landmark_strain", &TruthScore::landmark_strain)
      .def_readonly("mse_ratio", &TruthScore::mse_ratio)
      .def_readonly("rmse_raw_m", &TruthScore::rmse_raw_m)
      .def_readonly("rmse_corrected_m", &TruthScore::rmse_corrected_m)
      .def_readonly("readings", &TruthScore::readings)
      .def_readonly("estimated_stops", &TruthScore::estimated_stops)
      .def(picklable<TruthScore>());

  py::class_<JobResult, std::shared_ptr<JobResult>>(module, "JobResult")
      .def_property_readonly("calibrations", [](const JobResult& r) { return r.report.calibrations; })
      .def_property_readonly("models", [](const JobResult& r) { return r.report.models; })
      .def_property_readonly("notes", [](const JobResult& r) { return r.report.notes; })
      .def_property_readonly("check", [](const JobResult& r) { return r.report.check; })
      .def_readonly("scores", &JobResult::scores)
      .def(picklable<JobResult>());

  module.def("calibrate_job", &calibrate_job, py::arg("recordings"), py::arg("methods"), py::arg("order"),
             py::arg("curve"), py::arg("noise"), py::arg("noise_shape"), py::arg("solver"),
             py::arg("weights"), py::arg("check"), py::arg("from_"), py::arg("progress"));
}

}  // namespace rangecal::python
