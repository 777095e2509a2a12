// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <map>
#include <string>

namespace rangecal::formula {

/// A unit as a product of powers: "m", "1/m", "m/K", "rad", "m^2", "m/V^2"; "1" or "" for a number.
///
/// Angles (rad) and shares are numbers; dB and every other name but m, s, K and V are dimensions of their own. degC counts
/// as K: differences of temperatures.
class Unit {
 public:
  /// Throws std::invalid_argument with what is wrong.
  explicit Unit(const std::string& text);

  const std::string& text() const { return text_; }
  /// Exponents of the dimensions, without those that are 0.
  const std::map<std::string, int>& dimensions() const { return dimensions_; }
  /// How a value changes when the unit of each dimension is divided by its factor in `scale`.
  double factor(const std::map<std::string, double>& scale) const;
  /// The ending of a parameter's name: "_m", "_per_m", "_m_per_k", "_m2"; "" for a number without a unit's name.
  std::string ending() const;

 private:
  std::string text_;
  std::map<std::string, int> dimensions_;
  std::map<std::string, int> symbols_;  ///< as written, angles included
};

}  // namespace rangecal::formula
