// SPDX-License-Identifier: BSD-3-Clause
#include <pybind11/stl.h>

#include "archive_fields.hpp"
#include "arrays.hpp"
#include "module.hpp"
#include "rangecal/solvers/diagnosis/diagnosis.hpp"
#include "rangecal/solvers/diagnosis/model_residuals.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

std::shared_ptr<ModelResiduals> residuals_of(const std::vector<std::shared_ptr<Recording>>& recordings,
                                             const std::shared_ptr<Calibration>& calibration,
                                             const std::vector<std::string>& along) {
  const Recordings job({recordings.begin(), recordings.end()});
  return run_interruptible<std::shared_ptr<ModelResiduals>>(
      [job, calibration, along](const StageHook&) {
        return std::make_shared<ModelResiduals>(model_residuals(job.span(), *calibration, along));
      },
      py::none());
}

/// Of the seed model and of the final one, which are the same where nothing was found.
py::tuple residuals_of_diagnosis(const std::shared_ptr<Diagnosis>& diagnosis,
                                 const std::vector<std::shared_ptr<Recording>>& recordings) {
  const Recordings job({recordings.begin(), recordings.end()});
  const std::vector<Recording> read = relabelled(job.span(), diagnosis->simulation);
  const auto before = std::make_shared<ModelResiduals>(model_residuals(read, diagnosis->baseline));
  if (diagnosis->final_effects.empty()) return py::make_tuple(before, before);
  return py::make_tuple(
      before, std::make_shared<ModelResiduals>(
                  model_residuals(read, diagnosis->simulation.calibration, {}, diagnosis->simulation.added)));
}

}  // namespace

void bind_residuals(py::module_& module) {
  const auto reading = [](auto ReadingResidual::*member) {
    return [member](const py::object& self) {
      return field_view(self.cast<const ModelResiduals&>().readings, member, self);
    };
  };
  py::class_<ModelResiduals, std::shared_ptr<ModelResiduals>>(module, "Residuals")
      .def_property_readonly("recording", reading(&ReadingResidual::recording))
      .def_property_readonly("reading", reading(&ReadingResidual::reading))
      .def_property_readonly("stop", reading(&ReadingResidual::stop))
      .def_property_readonly("landmark", reading(&ReadingResidual::landmark))
      .def_property_readonly("repeat", reading(&ReadingResidual::repeat))
      .def_property_readonly("row", reading(&ReadingResidual::row))
      .def_property_readonly("reading_m", reading(&ReadingResidual::range_m))
      .def_property_readonly("bearing_rad", reading(&ReadingResidual::bearing_rad))
      .def_property_readonly("distance_m", reading(&ReadingResidual::distance_m))
      .def_property_readonly("range_residual_m", reading(&ReadingResidual::range_residual_m))
      .def_property_readonly("range_std_m", reading(&ReadingResidual::range_std_m))
      .def_property_readonly("bearing_residual_rad", reading(&ReadingResidual::bearing_residual_rad))
      .def_property_readonly("bearing_std_rad", reading(&ReadingResidual::bearing_std_rad))
      .def_property_readonly("corrected_m", reading(&ReadingResidual::corrected_m))
      .def_property_readonly("along",
                             [](const py::object& self) {
                               py::dict columns;
                               for (const auto& [name, values] : self.cast<const ModelResiduals&>().along)
                                 columns[py::str(name)] = view(values, self);
                               return columns;
                             })
      .def("__len__", [](const ModelResiduals& r) { return r.readings.size(); })
      .def(picklable<ModelResiduals>());
  module.def("residuals_of_diagnosis", &residuals_of_diagnosis, py::arg("diagnosis").none(false),
             py::arg("recordings"));
  module.def("residuals_job", &residuals_of, py::arg("recordings"), py::arg("calibration").none(false),
             py::arg("along"));
}

}  // namespace rangecal::python
