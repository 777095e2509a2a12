// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <stdexcept>
#include <string>

namespace rangecal {

/// One line of UTF-8 without control characters, at most 2000 bytes long, whatever a file held: what may be shown on a terminal.
std::string one_line(std::string text);

/// Wrong input: a file, an option or an argument that cannot be used as given. The message is one line that
/// names the file, the row (the line in the file, header = 1) and the column where there are any.
class InputError : public std::runtime_error {
 public:
  explicit InputError(const std::string& message);

  /// "FILE, row ROW, column 'COLUMN': WHAT"; row 0 and an empty column are left out.
  InputError(const std::string& file, long row, const std::string& column, const std::string& what);
};

/// Nothing is wrong with the input, but it holds too little for the answer that was asked for.
class NoAnswerError : public InputError {
 public:
  using InputError::InputError;
};

}  // namespace rangecal
