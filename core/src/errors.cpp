// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/errors.hpp"

#include <string_view>

#include "rangecal/core/utf8.hpp"

namespace rangecal {
namespace {

constexpr std::size_t longest = 2000;

std::string compose(const std::string& file, long row, const std::string& column, const std::string& what) {
  std::string message = file;
  if (row > 0) message += ", row " + std::to_string(row);
  if (!column.empty()) message += ", column '" + column + "'";
  return message + ": " + what;
}

}  // namespace

std::string one_line(std::string text) {
  if (text.size() > longest) {
    std::size_t end = longest - 3;
    while (end > 0 && (static_cast<unsigned char>(text[end]) & 0xc0) == 0x80)
      --end;  // not within a character
    text.resize(end);
    text += "...";
  }
  text.erase(text.find_last_not_of(" \r\n") + 1);
  for (char& c : text)
    if (c == '\n' || c == '\r')
      c = ' ';
    else if (static_cast<unsigned char>(c) < 0x20 || c == 0x7f)
      c = '?';
  for (std::size_t from = 0, bad;
       (bad = first_bad_byte(std::string_view(text).substr(from))) != std::string_view::npos;) {
    text[from + bad] = '?';
    from += bad + 1;
  }
  return text;
}

InputError::InputError(const std::string& message) : std::runtime_error(one_line(message)) {}

InputError::InputError(const std::string& file, long row, const std::string& column, const std::string& what)
    : std::runtime_error(one_line(compose(file, row, column, what))) {}

}  // namespace rangecal
