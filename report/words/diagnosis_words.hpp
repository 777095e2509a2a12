// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <string>
#include <vector>

#include "rangecal/solvers/diagnosis/diagnosis.hpp"

namespace rangecal::app {

/// Factor and name of the unit that a value stored in SI is shown in.
struct Shown {
  double factor = 1.0;
  std::string unit;
};
/// "m" in mm, "rad" in deg; others as they are.
Shown shown(const std::string& si);
/// The unit of a parameter by its name's ending. Lengths of centimetres and less are in mm.
Shown unit_of(const EffectEstimate& estimate);

/// "angle 5 deg, offset 3 mm": the typical size of an effect that could be hidden.
std::string typical_in_words(const Unseen& unseen);
/// The size of its first parameter from which on it would show, in that parameter's unit; "no size" where none would.
std::string detectable_in_words(const Unseen& unseen);

bool ends_with(const std::string& text, const std::string& end);
/// Smaller p-values are said to be less than this: so far out no model is true enough for the digits to mean anything.
inline constexpr double least_p_value = 1e-12;
/// "p = 3e-10", "p < 1e-12".
std::string p_in_words(double p);
/// "7.5 mm RMS", "spread x 1.6", "labels exchanged": how large a finding is.
std::string size_in_words(const Finding& finding);
/// " from -23 to 51 deg", " at B", or nothing: where along its covariate, in the unit a user reads it in.
std::string place(const Finding& finding);
/// "bearing along time (linear) from 0 to 40 s: 0.2 deg RMS, 87 % of the excess, p < 1e-12": a finding in one line. Shares
/// that noise carries beyond one are all of the excess.
std::string finding_in_words(const Finding& finding);
/// A range error in mm to two digits; below what can be measured as a bound.
std::string millimetres(double harm_m);

/// A row of the table before and after; `after` and `note` are empty where nothing was added to the model.
struct BeforeAfter {
  std::string name, before, after, note;
};
std::vector<BeforeAfter> before_after_rows(const Diagnosis& diagnosis);
/// "held out: 36 groups of trial": as many blocks of one size as they amount to; empty where nothing was held out.
std::string held_out_in_words(const Diagnosis& diagnosis);

/// "a or b, beside the others": a set of names and another one that the recording cannot tell from it, by what they do not have in common.
std::string rivals_in_words(const std::vector<std::string>& names, const std::vector<std::string>& others);

/// A law as a user reads it.
struct LawRow {
  std::string formula, evidence;        ///< "12.3 nats above the answer without a law"
  std::vector<std::string> parameters;  ///< "a1 = 15.9 +- 0.4 mm"
  bool agrees = false;                  ///< with the first, wherever there are readings
};
std::vector<LawRow> law_rows(const Diagnosis& diagnosis);

/// A parameter as a user reads it.
struct ParameterRow {
  std::string name, value, unit;
};
/// What speaks for one name; "-" where it is not known.
struct MemberRow {
  std::string effect, probability, evidence, held_out;  ///< the last two: nats lost without it
};
std::vector<MemberRow> member_rows(const Diagnosis& diagnosis);

/// The effects' parameters and what is left of the calibration beside them.
std::vector<ParameterRow> parameter_rows(const Diagnosis& diagnosis);

}  // namespace rangecal::app
