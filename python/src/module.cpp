// SPDX-License-Identifier: BSD-3-Clause
#include "module.hpp"

#include <glog/logging.h>

#include "rangecal/core/errors.hpp"
#include "rangecal/core/quantiles.hpp"
#include "work.hpp"

PYBIND11_MODULE(_native, module) {
  using namespace rangecal::python;
  module.doc() = "The C++ side of rangecal; use the package `rangecal`.";
  module.attr("__version__") = RANGECAL_VERSION;
  module.attr("z95") = rangecal::z95;
  module.attr("radius95") = rangecal::radius95;
  FLAGS_minloglevel = google::GLOG_FATAL;  // Ceres logs through glog, to stderr unless told otherwise

  py::register_exception<rangecal::InputError>(module, "InputError", PyExc_ValueError);
  bind_recording(module);
  bind_calibration(module);
  bind_calibrate(module);
  bind_correct(module);
  bind_simulate(module);
  bind_diagnosis(module);
  bind_residuals(module);
  bind_study(module);
  bind_report(module);
  bind_ingest(module);
  py::module_::import("atexit").attr("register")(py::cpp_function(&join_leftovers));
}
