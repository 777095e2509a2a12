// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/errors.hpp"

namespace rangecal {
namespace {

std::string compose(const std::string& file, long row, const std::string& column, const std::string& what) {
  std::string message = file;
  if (row > 0) message += ", row " + std::to_string(row);
  if (!column.empty()) message += ", column '" + column + "'";
  message += ": " + what;
  // One line, whatever the file held: control characters would break the promise.
  for (char& c : message) {
    if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f) c = '?';
  }
  return message;
}

}  // namespace

InputError::InputError(const std::string& file, long row, const std::string& column, const std::string& what)
    : std::runtime_error(compose(file, row, column, what)) {}

}  // namespace rangecal
