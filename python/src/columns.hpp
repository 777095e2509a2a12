// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/pybind11.h>

#include <string>

namespace rangecal::python {

namespace py = pybind11;

/// Columns by name as the text of a CSV table, for the library's readers to check like a file: numbers in
/// their shortest text that reads back exactly, NaN and None as empty fields. A column is a one-dimensional
/// array of numbers or any sequence of texts; all have one length. Throws InputError naming `table` and the
/// column that does not fit.
std::string csv_text(const py::dict& columns, const std::string& table);

}  // namespace rangecal::python
