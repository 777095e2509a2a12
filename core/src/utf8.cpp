// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/utf8.hpp"

#include <cstdint>
#include <cstring>

namespace rangecal {
namespace {

/// True if none of the eight bytes is NUL or beyond ASCII.
bool plain(const char* bytes) {
  std::uint64_t word = 0;
  std::memcpy(&word, bytes, sizeof word);
  constexpr std::uint64_t ones = 0x0101010101010101u, tops = 0x8080808080808080u;
  return (((word - ones) | word) & tops) == 0;
}

/// Length of the sequence that begins with this byte; 0 if none does.
std::size_t sequence_length(unsigned char byte) {
  if (byte < 0x80) return byte == 0 ? 0 : 1;
  if (byte < 0xc2) return 0;
  return byte < 0xe0 ? 2 : byte < 0xf0 ? 3 : byte < 0xf5 ? 4 : 0;
}

}  // namespace

std::size_t first_bad_byte(std::string_view text) {
  for (std::size_t i = 0; i < text.size();) {
    if (i + 8 <= text.size() && plain(text.data() + i)) {
      i += 8;
      continue;
    }
    const std::size_t length = sequence_length(static_cast<unsigned char>(text[i]));
    if (length == 0 || i + length > text.size()) return i;
    for (std::size_t k = 1; k < length; ++k)
      if ((static_cast<unsigned char>(text[i + k]) & 0xc0) != 0x80) return i;
    if (length >= 3) {  // too long for what they say, surrogates, beyond U+10FFFF
      const auto first = static_cast<unsigned char>(text[i]),
                 second = static_cast<unsigned char>(text[i + 1]);
      if ((first == 0xe0 && second < 0xa0) || (first == 0xed && second > 0x9f) ||
          (first == 0xf0 && second < 0x90) || (first == 0xf4 && second > 0x8f))
        return i;
    }
    i += length;
  }
  return std::string_view::npos;
}

}  // namespace rangecal
