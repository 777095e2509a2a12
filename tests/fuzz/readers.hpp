// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <string_view>
#include <vector>

namespace rangecal::fuzz {

/// A reader of the project, fed with bytes in the place of its file. Several files are one text: "=== NAME"
/// on a line of its own begins the file NAME.
struct Reader {
  const char* name;
  void (*feed)(std::string_view bytes);
};

const std::vector<Reader>& readers();

/// Feeds the reader. What a reader owes: it takes the bytes, or throws InputError with one line of UTF-8.
/// Returns that line or nothing; anything else that is thrown passes through, and a broken promise ends in
/// std::logic_error.
std::string feed(const Reader& reader, std::string_view bytes);

}  // namespace rangecal::fuzz
