// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <Eigen/Core>
#include <cstddef>
#include <optional>
#include <vector>

namespace rangecal::python {

namespace py = pybind11;

/// A read-only NumPy array on the memory that `owner` holds: nothing is copied, and `owner` lives as long as
/// the array.
template <typename T>
py::array view(const T* data, std::vector<py::ssize_t> shape, std::vector<py::ssize_t> strides,
               py::handle owner) {
  py::array array(py::dtype::of<T>(), std::move(shape), std::move(strides), data, owner);
  array.attr("setflags")(py::arg("write") = false);
  return array;
}

/// (n,) on a vector.
template <typename T>
py::array view(const std::vector<T>& values, py::handle owner) {
  return view(values.data(), {static_cast<py::ssize_t>(values.size())}, {sizeof(T)}, owner);
}

/// (n,) on an Eigen vector.
inline py::array view(const Eigen::VectorXd& values, py::handle owner) {
  return view(values.data(), {values.size()}, {sizeof(double)}, owner);
}

/// (rows, columns) on an Eigen matrix.
inline py::array view(const Eigen::MatrixXd& matrix, py::handle owner) {
  return view(matrix.data(), {matrix.rows(), matrix.cols()},
              {sizeof(double), static_cast<py::ssize_t>(sizeof(double)) * matrix.rows()}, owner);
}

/// On the vector or matrix, or None.
inline py::object view(const std::optional<Eigen::VectorXd>& values, py::handle owner) {
  return values ? py::object(view(*values, owner)) : py::none();
}
inline py::object view(const std::optional<Eigen::MatrixXd>& matrix, py::handle owner) {
  return matrix ? py::object(view(*matrix, owner)) : py::none();
}

/// (n,) or (n, width) on `width` numbers that stand side by side in every item, from `first` on.
template <typename Item, typename T>
py::array field_view(const std::vector<Item>& items, const T* first, py::ssize_t width, py::handle owner) {
  const auto count = static_cast<py::ssize_t>(items.size());
  if (width == 1) return view(first, {count}, {sizeof(Item)}, owner);
  return view(first, {count, width}, {sizeof(Item), sizeof(T)}, owner);
}

/// (n,) on one member of every item.
template <typename Item, typename T>
py::array field_view(const std::vector<Item>& items, T Item::*member, py::handle owner) {
  static const T none{};
  return field_view(items, items.empty() ? &none : &(items.front().*member), 1, owner);
}

}  // namespace rangecal::python
