// SPDX-License-Identifier: BSD-3-Clause
#include "columns.hpp"

#include <fmt/compile.h>
#include <fmt/format.h>
#include <pybind11/numpy.h>
#include <pybind11/stl.h>

#include <cmath>
#include <iterator>
#include <utility>
#include <vector>

#include "rangecal/core/csv_table.hpp"
#include "rangecal/core/errors.hpp"

namespace rangecal::python {
namespace {

using Numbers = py::array_t<double, py::array::c_style | py::array::forcecast>;

/// One column: numbers, or texts.
struct Column {
  std::string name;
  Numbers numbers;
  std::vector<std::string> texts;
  bool is_text = false;

  std::size_t size() const { return is_text ? texts.size() : static_cast<std::size_t>(numbers.size()); }

  void append(std::string& text, std::size_t row) const {
    if (is_text) {
      text += csv_field(texts[row]);
      return;
    }
    const double value = numbers.data()[row];
    if (!std::isnan(value)) fmt::format_to(std::back_inserter(text), FMT_COMPILE("{}"), value);
  }
};

std::string text_of(const py::handle& item) {
  if (item.is_none()) return {};
  if (py::isinstance<py::float_>(item) && std::isnan(item.cast<double>())) return {};
  return py::str(item);
}

Column column_of(const std::string& table, const std::string& name, const py::handle& values) {
  Column column;
  column.name = name;
  const py::array array = py::array::ensure(values);
  if (!array || array.ndim() != 1) throw InputError(table, 0, name, "is not one-dimensional");
  const char kind = array.dtype().kind();
  column.is_text = kind != 'f' && kind != 'i' && kind != 'u' && kind != 'b';
  if (!column.is_text) {
    column.numbers = Numbers::ensure(array);
    return column;
  }
  for (const py::handle& item : array.attr("tolist")()) column.texts.push_back(text_of(item));
  return column;
}

}  // namespace

std::string csv_text(const py::dict& columns, const std::string& table) {
  std::vector<Column> parts;
  for (const auto& [name, values] : columns) parts.push_back(column_of(table, py::str(name), values));
  std::string text;
  for (const Column& part : parts) {
    if (part.size() != parts.front().size())
      throw InputError(table, 0, part.name,
                       fmt::format("has {} entries, where '{}' has {}", part.size(), parts.front().name,
                                   parts.front().size()));
    text += (text.empty() ? "" : ",") + csv_field(part.name);
  }
  text += '\n';
  for (std::size_t row = 0; !parts.empty() && row < parts.front().size(); ++row) {
    for (std::size_t c = 0; c < parts.size(); ++c) {
      if (c > 0) text += ',';
      parts[c].append(text, row);
    }
    if (text.back() == '\n') text += "\"\"";  // a row of one empty field is no blank line
    text += '\n';
  }
  return text;
}

}  // namespace rangecal::python
