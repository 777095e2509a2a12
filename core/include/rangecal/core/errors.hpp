// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace rangecal {

/// Wrong input: a file, an option or an argument that cannot be used as given. The message is one line that
/// names the file, the row (the line in the file, header = 1) and the column where there are any.
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& message) : std::runtime_error(message) {}

  /// "FILE, row ROW, column 'COLUMN': WHAT"; row 0 and an empty column are left out.
  InputError(const std::string& file, long row, const std::string& column, const std::string& what);
};

/// Nothing is wrong with the input, but it holds too little for the answer that was asked for.
class NoAnswerError : public InputError {
 public:
  using InputError::InputError;
};

}  // namespace rangecal
