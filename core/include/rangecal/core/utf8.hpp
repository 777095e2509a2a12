// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstddef>
#include <string_view>

namespace rangecal {

/// What some programs, spreadsheets among them, begin UTF-8 text with; no part of the text.
inline constexpr std::string_view byte_order_mark = "\xef\xbb\xbf";

/// The place of the first byte that no UTF-8 text holds (malformed sequences, NUL), or npos.
std::size_t first_bad_byte(std::string_view text);

}  // namespace rangecal
