// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

#include <limits>
#include <memory>
#include <span>
#include <vector>

#include "rangecal/core/recording.hpp"

namespace rangecal::python {

namespace py = pybind11;

/// Stands in arrays for what is not known.
inline constexpr double nan = std::numeric_limits<double>::quiet_NaN();

/// Each binds one concept into the module `rangecal._native`.
void bind_recording(py::module_& module);
void bind_calibration(py::module_& module);
void bind_calibrate(py::module_& module);
void bind_correct(py::module_& module);
void bind_simulate(py::module_& module);
void bind_diagnosis(py::module_& module);
void bind_residuals(py::module_& module);
void bind_study(py::module_& module);
void bind_report(py::module_& module);
void bind_ingest(py::module_& module);

/// The recordings of a call, kept alive as long as its work runs; one is not copied.
class Recordings {
 public:
  explicit Recordings(std::vector<std::shared_ptr<const Recording>> recordings);
  std::span<const Recording> span() const;

 private:
  std::shared_ptr<const Recording> one_;
  std::shared_ptr<const std::vector<Recording>> several_;
};

}  // namespace rangecal::python
