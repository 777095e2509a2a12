// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <cstdint>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "scoring.hpp"

namespace rangecal::proof {

/// A table of readings at known distances as a new user has it: 400 to 800 rows without repeats, one column or two, and what
/// is in it.
///
///   y = f(d) + causes + s f(d)^2 e,   f of order 2, d from 0.3 to 4 .. 10 m, s from 0.0008 to 0.004 / m
///
/// Of every cause the change of a reading is 0.4 to 2 times the noise at the median reading.
struct EverydayTable {
  std::string kind;  ///< "temperature", ...
  Recording recording;
  std::vector<std::vector<std::string>> causes;  ///< of each the names that are right
  Eigen::Vector3d alpha;                         ///< f
  bool level_is_alpha_0 =
      false;  ///< the causes change readings by 0 on average: the curve can be held against f
};

/// The kinds, in turns by the number of the table:
///   temperature, temperature-scale, supply-voltage (its square), received-power, humidity, dust (times range),
///   two-devices (and a warm-up), periodic-late (8 % late returns), temperature-early (6 % early echoes),
///   temperature-rounded (to 1 cm), temperature-voltage, reciprocal (y = a + b / (d + c): a curve, and no cause)
const std::vector<std::string>& everyday_kinds();

EverydayTable draw_everyday(const std::string& kind, std::uint64_t seed);

/// The answer for one table: right where every cause has a right name and nothing else is named, and the verdict is
/// `explained`, or `no_mismatch` where there is no cause. Coverage: of f at three distances, where it can be told.
Score score_everyday(const EverydayTable& table, const Diagnosis& diagnosis);

}  // namespace rangecal::proof
