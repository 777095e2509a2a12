// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <Eigen/Core>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "rangecal/core/recording.hpp"
#include "rangecal/problems/effects/effect.hpp"

namespace rangecal {

/// The effect that a text states as a formula (docs/effects-by-formula.md). `file` names it in messages. Throws InputError with file, row
/// and field for what cannot be used: an unknown field, a formula that cannot be read, units that do not fit, a change that does
/// not vanish with its parameters, one that is no finite number.
std::unique_ptr<Effect> effect_from_formula(const std::string& yaml, const std::string& file);

/// The same of a file.
std::unique_ptr<Effect> effect_from_file(const std::string& path);

/// True if a formula can ask for a covariate column of that name: a name, and no variable or function.
bool is_column_of_formulas(const std::string& name);
/// The unit that a formula takes the column to be in, by its name: decibels for dBm, K for degC, "1" where the name says none.
std::string unit_of_column_in_formulas(const std::string& name);

/// What a text states of its parameters, as a law that was found does.
struct StatedValues {
  Eigen::VectorXd value;    ///< `value` of each; empty where one has none, or the effect is no formula
  Eigen::VectorXd std_dev;  ///< `std` of each, 0 where it has none
};
StatedValues stated_values(const Effect& effect);

/// Reads every .yaml file of a folder and adds its effect to those that find_effect and effects_of know, for the rest of the
/// program; returns their ids in order. An effect that was added before with the same text stays. Throws InputError as
/// effect_from_formula, where the folder holds no such file, and for an id that is taken.
std::vector<std::string> add_effects_by_formula(const std::string& folder);

/// Throws InputError where an effect that was added asks for a column that none of the recordings has.
void require_columns_of_formulas(std::span<const Recording> recordings);

/// A built-in effect in the form that effect_from_formula reads; empty where its change is no formula of one reading (changes of stops,
/// dependence, grids, exchanged labels, parameters that are chosen from the recording).
std::string as_formula(const Effect& effect);

/// A parameter's name without the unit that it ends in, and that unit: "curvature_per_m" is "curvature" in "1/m"; "1": a number.
struct ParameterName {
  std::string name, unit;
};
ParameterName parameter_name(const std::string& full);

}  // namespace rangecal
