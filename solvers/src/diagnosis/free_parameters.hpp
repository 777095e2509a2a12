// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <algorithm>
#include <cmath>
#include <utility>
#include <vector>

#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// The parameters of the model that a fit moves, and what each acts on; of the first `settled` effects those that only
/// the value of the likelihood knows stay.
std::vector<FreeParameter> free_parameters(const Rows& rows, const Projector& projector, const Model& model,
                                           int settled);

inline double& value_of(Model& model, const FreeParameter& p) { return model[p.effect].parameters[p.index]; }
inline double value_of(const Model& model, const FreeParameter& p) {
  return model[p.effect].parameters[p.index];
}

inline const EffectParameter& info_of(const Model& model, const FreeParameter& p) {
  return model[p.effect].effect->info().parameters[p.index];
}

/// The size that a parameter usually has, whatever its sign; a unit of its steps and of its prior.
inline double size_of(const EffectParameter& parameter) {
  return std::max(std::abs(parameter.typical), 1e-12);
}

/// Its least and largest value in this recording.
inline std::pair<double, double> bounds_of(const Rows& rows, const Model& model, const FreeParameter& p) {
  return model[p.effect].effect->bounds(rows.context, static_cast<std::size_t>(p.index));
}

/// True if it is at one of them, and the slope of its likelihood leads beyond.
inline bool is_stuck(const Rows& rows, const Model& model, const FreeParameter& p, double slope) {
  const auto [low, high] = bounds_of(rows, model, p);
  const double value = model[p.effect].parameters[p.index];
  return slope > 0.0 ? value >= high : value <= low;
}

/// Keeps a parameter where it is in a step of score and information: others take no part of it, and it none of theirs.
inline void hold(Eigen::Index place, Eigen::VectorXd& score, Eigen::MatrixXd& information) {
  score[place] = 0.0;
  information.row(place).setZero();
  information.col(place).setZero();
  information(place, place) = 1.0;
}

/// True if it ended at one of them, to a millionth of what lies between.
inline bool ended_at_bound(const Rows& rows, const Model& model, const FreeParameter& p) {
  const auto [low, high] = bounds_of(rows, model, p);
  const double value = model[p.effect].parameters[p.index], close = 1e-6 * (high - low);
  return value <= low + close || value >= high - close;
}

}  // namespace rangecal::diagnosis
