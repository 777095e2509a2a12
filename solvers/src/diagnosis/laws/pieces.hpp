// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <numbers>
#include <optional>
#include <string>
#include <vector>

#include "diagnosis/rows.hpp"

namespace rangecal::diagnosis {

/// A parameter of a law that is looked for.
struct LawParameter {
  std::string name, unit;
  double typical = 0.0, low = 0.0, high = 0.0;
  int starts = 0;      ///< values that a fit of one that is not linear starts from
  bool whole = false;  ///< a whole number
  std::optional<double> value = {}, std_dev = {};  ///< where it was estimated
};

/// A number of a law that is known.
struct LawConstant {
  std::string name, unit;
  double value = 0.0;
};

/// What the readings are at hand in, and over which values.
struct LawVariable {
  static constexpr std::size_t fewest_values = 5;
  std::string name, unit;  ///< "d", "t", "b", or a column
  double low = 0.0, high = 0.0, mean = 0.0;
  bool is_angle = false;  ///< the same after a whole turn
  bool varies = false;  ///< it has so many values or more: laws can be found along it
  int column = -1;      ///< of EffectContext::covariates
  double span() const { return high - low; }
  /// Its values lie around more than half a turn: none of them is an end, and no power of it is a law.
  bool goes_round() const { return is_angle && span() > std::numbers::pi; }
};

/// All that have a value: d, t, b, and the columns that a formula can ask for.
std::vector<LawVariable> law_variables(const Rows& rows);

/// One term of a law: a formula of docs/effects-by-formula.md, of one channel, with what its names are.
struct LawPiece {
  std::string formula;
  std::vector<LawParameter> parameters;
  std::vector<LawConstant> constants;
  std::vector<std::string> variables;  ///< what it depends on
  std::string words;                   ///< what it is: "a wave along t"
};

/// Terms that a change of the channel ("range", "bearing", "range_noise", "bearing_noise") may be made of, over all that these readings
/// vary in: powers, logarithm, decay, bump, edge, window and wave along d, t, every column, and directions of less than half a turn;
/// ripples, bumps and sectors of directions and columns of angles; products of two of t and the columns; of ranges each times d and d^2
/// too, of bearings each over d. Names of parameters end in `number`.
std::vector<LawPiece> law_pieces(const Rows& rows, const std::string& channel, int number);

/// The sum of terms as the text of an effect by formula.
std::string law_text(const std::vector<LawPiece>& pieces, const std::string& id, const std::string& channel);

}  // namespace rangecal::diagnosis
