// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>

#include "diagnosis/working.hpp"

namespace rangecal::diagnosis {

/// The laws of the noise that are tried, that of triangulation first; and the nats by which another has to beat it.
inline constexpr NoiseLaw triangulation_first[] = {NoiseLaw::f_squared, NoiseLaw::f, NoiseLaw::constant,
                                                   NoiseLaw::f_cubed};
inline constexpr double law_margin = 3.0;

/// The noise law from the repeats alone, which no effect can mislead that is the same for all repeats of a cell: the triangulation law unless
/// another is better by more than `law_margin`, and its sigma, the grids' part taken off. Of a law the normal or a
/// heavy-tailed shape counts, whichever is likelier, so that outliers choose none. Empty where there are too few repeats. The mean reading stands for f.
/// `model`: its grids, and, at a `state`, what its effects do to ranges from one repeat to another and to their variance, are taken off.
std::optional<Noise> noise_within_cells(const Rows& rows, const Model& model,
                                        const JointState* state = nullptr);

/// The largest step of range [m] where, of the cells with repeats, a quarter or more have repeats that are all
/// alike, else 0.
/// There a cell's error is a saw of its distance, the rest an occasional step that looks like a tail: nothing
/// smaller than a step can be told from them.
double step_beyond_noise(const Rows& rows, const Model& grids);

}  // namespace rangecal::diagnosis
