// SPDX-License-Identifier: BSD-3-Clause
// What the reader and the writer of MCAP share: opcodes, checksum, fields of a record.
#pragma once

#include <array>
#include <bit>
#include <cstdint>
#include <cstring>
#include <span>
#include <string>

namespace rangecal::ingest::mcap {

using ByteSpan = std::span<const std::byte>;

inline constexpr std::uint64_t kMagicSize = 8, kRecordHead = 9, kFooterContent = 20, kDataEndContent = 4;
inline constexpr unsigned char kMagic[kMagicSize] = {0x89, 'M', 'C', 'A', 'P', '0', '\r', '\n'};
inline constexpr std::uint64_t kLongestName = 4096;

enum Opcode : unsigned {
  op_header = 0x01,
  op_footer = 0x02,
  op_schema = 0x03,
  op_channel = 0x04,
  op_message = 0x05,
  op_chunk = 0x06,
  op_message_index = 0x07,
  op_chunk_index = 0x08,
  op_attachment = 0x09,
  op_attachment_index = 0x0a,
  op_statistics = 0x0b,
  op_metadata = 0x0c,
  op_metadata_index = 0x0d,
  op_summary_offset = 0x0e,
  op_data_end = 0x0f,
  op_first_private = 0x80
};

/// CRC-32 of IEEE 802.3 (polynomial 04c11db7, reflected), eight bytes at a time: table k holds the CRC of a byte that k bytes
/// follow.
class Crc32 {
 public:
  void add(ByteSpan bytes) {
    static const Tables tables = make_tables();
    const std::byte* at = bytes.data();
    std::size_t left = bytes.size();
    for (; left >= 8; at += 8, left -= 8) {
      std::uint32_t low, high;
      std::memcpy(&low, at, 4), std::memcpy(&high, at + 4, 4);
      if constexpr (std::endian::native == std::endian::big)
        low = __builtin_bswap32(low), high = __builtin_bswap32(high);
      low ^= crc_;
      crc_ = tables[7][low & 0xff] ^ tables[6][low >> 8 & 0xff] ^ tables[5][low >> 16 & 0xff] ^
             tables[4][low >> 24] ^ tables[3][high & 0xff] ^ tables[2][high >> 8 & 0xff] ^
             tables[1][high >> 16 & 0xff] ^ tables[0][high >> 24];
    }
    for (; left > 0; ++at, --left)
      crc_ = tables[0][(crc_ ^ std::to_integer<std::uint32_t>(*at)) & 0xff] ^ crc_ >> 8;
  }
  std::uint32_t value() const { return ~crc_; }

 private:
  using Tables = std::array<std::array<std::uint32_t, 256>, 8>;
  static Tables make_tables() {
    Tables tables{};
    for (std::uint32_t i = 0; i < 256; ++i) {
      std::uint32_t crc = i;
      for (int bit = 0; bit < 8; ++bit) crc = crc >> 1 ^ (crc & 1 ? 0xedb88320u : 0u);
      tables[0][i] = crc;
    }
    for (std::size_t k = 1; k < 8; ++k)
      for (std::size_t i = 0; i < 256; ++i)
        tables[k][i] = tables[0][tables[k - 1][i] & 0xff] ^ tables[k - 1][i] >> 8;
    return tables;
  }
  std::uint32_t crc_ = ~std::uint32_t{0};
};

/// The fields of a record, one after the other; zeros, and sound() false, once they run beyond its end.
class RecordFields {
 public:
  explicit RecordFields(ByteSpan bytes) : bytes_(bytes) {}
  std::uint64_t number(std::size_t size) {
    std::uint64_t value = 0;
    const ByteSpan found = take(size);
    if constexpr (std::endian::native == std::endian::little) {
      if (!found.empty()) std::memcpy(&value, found.data(), found.size());
    } else {
      for (std::size_t i = found.size(); i-- > 0;)
        value = value << 8 | std::to_integer<std::uint64_t>(found[i]);
    }
    return value;
  }
  std::uint16_t id() { return static_cast<std::uint16_t>(number(2)); }
  std::uint32_t crc() { return static_cast<std::uint32_t>(number(4)); }
  std::string name() {
    const std::uint64_t size = number(4);
    if (size > kLongestName) sound_ = false;
    const ByteSpan found = take(size);
    return {reinterpret_cast<const char*>(found.data()), found.size()};
  }
  ByteSpan take(std::uint64_t size) {
    if (!sound_ || size > bytes_.size()) {
      sound_ = false;
      return {};
    }
    const ByteSpan found = bytes_.first(size);
    bytes_ = bytes_.subspan(size);
    return found;
  }
  ByteSpan rest() const { return bytes_; }
  bool sound() const { return sound_; }

 private:
  ByteSpan bytes_;
  bool sound_ = true;
};

}  // namespace rangecal::ingest::mcap
