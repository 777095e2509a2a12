// SPDX-License-Identifier: BSD-3-Clause
#include "rangecal/core/random.hpp"

#include <cmath>

namespace rangecal {
namespace {

// splitmix64 (Steele, Lea, Flood 2014): a bijection of 64 bits in which every input bit moves every output bit.
std::uint64_t splitmix64(std::uint64_t x) {
  x += 0x9e3779b97f4a7c15ULL;
  x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9ULL;
  x = (x ^ (x >> 27)) * 0x94d049bb133111ebULL;
  return x ^ (x >> 31);
}

}  // namespace

std::uint64_t seed_from(std::string_view name, std::initializer_list<std::uint64_t> indices) {
  std::uint64_t hash = 0xcbf29ce484222325ULL;  // FNV-1a over the name's bytes
  for (const char c : name) {
    hash ^= static_cast<unsigned char>(c);
    hash *= 0x100000001b3ULL;
  }
  hash = splitmix64(hash);
  for (const std::uint64_t index : indices) hash = splitmix64(hash ^ splitmix64(index));
  return hash;
}

double Random::uniform() { return static_cast<double>(engine_() >> 11) * 0x1.0p-53; }

double Random::normal() {
  if (has_spare_) {
    has_spare_ = false;
    return spare_;
  }
  // Marsaglia's polar method: (u, v) uniform in the unit disc gives two independent N(0, 1).
  double u = 0.0, v = 0.0, square = 0.0;
  do {
    u = 2.0 * uniform() - 1.0;
    v = 2.0 * uniform() - 1.0;
    square = u * u + v * v;
  } while (square >= 1.0 || square == 0.0);
  const double factor = std::sqrt(-2.0 * std::log(square) / square);
  spare_ = v * factor;
  has_spare_ = true;
  return u * factor;
}

std::uint64_t Random::index(std::uint64_t size) {
  if (size <= 1) return 0;
  // Draws below 2^64 mod size are refused, so that every index is equally likely.
  const std::uint64_t refused = (0 - size) % size;
  std::uint64_t draw = engine_();
  while (draw < refused) draw = engine_();
  return draw % size;
}

}  // namespace rangecal
