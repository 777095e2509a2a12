// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <cstdint>
#include <initializer_list>
#include <random>
#include <string_view>

namespace rangecal {

/// A 64-bit seed from a name and any number of indices: the same on every machine, and different streams for
/// different (name, indices). Used so that the random numbers of a case depend on nothing but what the case is.
std::uint64_t seed_from(std::string_view name, std::initializer_list<std::uint64_t> indices = {});

/// Random numbers that are the same with every standard library (std::normal_distribution is not).
class Random {
 public:
  explicit Random(std::uint64_t seed) : engine_(seed) {}

  double uniform();  ///< uniform in [0, 1), 53 bits
  double uniform(double low, double high) { return low + (high - low) * uniform(); }
  double normal();  ///< N(0, 1), by the polar method
  double normal(double mean, double sigma) { return mean + sigma * normal(); }
  std::uint64_t index(std::uint64_t size);  ///< uniform in 0 .. size-1
  std::uint64_t bits() { return engine_(); }

 private:
  std::mt19937_64 engine_;
  double spare_ = 0.0;
  bool has_spare_ = false;
};

}  // namespace rangecal
