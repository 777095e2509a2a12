// SPDX-License-Identifier: BSD-3-Clause
#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <utility>
#include <vector>

#include "columns.hpp"
#include "module.hpp"
#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"
#include "rangecal/solvers/correction/candidates.hpp"
#include "work.hpp"

namespace rangecal::python {
namespace {

/// Every candidate of every reading, one after the other.
struct Candidates {
  std::vector<py::ssize_t> reading;  ///< index of the reading
  std::vector<double> distance_m, std_m;
  std::vector<int> candidate;
  std::vector<std::string> flag;
};

template <typename T>
py::array_t<T> array_of(const std::vector<T>& values) {
  return py::array_t<T>(static_cast<py::ssize_t>(values.size()), values.data());
}

py::dict correct_readings(const std::shared_ptr<Calibration>& calibration,
                          const py::array_t<double, py::array::c_style | py::array::forcecast>& readings,
                          const py::dict& columns, const std::string& roots) {
  if (roots != "ls" && roots != "ml") throw InputError("roots is '" + roots + "', not ls or ml");
  require_curve(*calibration, "the calibration");
  const std::vector<double> values(readings.data(), readings.data() + readings.size());
  const std::string text =
      calibration->effects.empty() || columns.empty() ? "" : csv_text(columns, "readings");
  const bool likelihood = roots == "ml";
  const Candidates found = run_interruptible<Candidates>(
      [calibration, values, text, likelihood](const StageHook& hook) {
        std::optional<CsvTable> table;
        if (!text.empty()) table = CsvTable::parse(text, "readings");
        if (table && table->rows() != values.size())
          throw InputError(fmt::format("readings: {} of them, where their columns have {} entries",
                                       values.size(), table->rows()));
        const ReadingSettings settings =
            reading_settings(*calibration, table ? &*table : nullptr, "readings", values.size());
        Candidates all;
        for (std::size_t i = 0; i < values.size(); ++i) {
          if (i % 65536 == 65535)
            hook("correcting", static_cast<double>(i) / static_cast<double>(values.size()));
          for (CorrectionCandidate& c :
               correction_candidates(settings.corrector, values[i], settings.of_reading[i], likelihood)) {
            all.reading.push_back(static_cast<py::ssize_t>(i));
            all.distance_m.push_back(c.distance_m.value_or(nan));
            all.std_m.push_back(c.std_dev_m.value_or(nan));
            all.candidate.push_back(c.candidate);
            all.flag.push_back(std::move(c.flag));
          }
        }
        return all;
      },
      py::none());
  py::dict result;
  result["reading"] = array_of(found.reading);
  result["distance_m"] = array_of(found.distance_m);
  result["std_m"] = array_of(found.std_m);
  result["candidate"] = array_of(found.candidate);
  result["flag"] = found.flag;
  return result;
}

/// Columns that the effects of a calibration depend on.
std::vector<std::string> columns_needed(const Calibration& calibration) {
  require_curve(calibration, "the calibration");
  std::vector<std::string> columns;
  for (EffectCorrector::Need& need : EffectCorrector(calibration, {}).needs())
    columns.push_back(std::move(need.column));
  return columns;
}

}  // namespace

void bind_correct(py::module_& module) {
  module.def("correct_readings", &correct_readings, py::arg("calibration").none(false), py::arg("readings"),
             py::arg("columns"), py::arg("roots"));
  module.def("columns_needed", &columns_needed, py::arg("calibration"));
}

}  // namespace rangecal::python
