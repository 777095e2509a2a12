// SPDX-License-Identifier: BSD-3-Clause
#pragma once

namespace rangecal::diagnosis {

/// Everything about the posterior and the verdict of a search by sets that was chosen and not computed.
struct SelectionPriors {
  /// Prior probability of a member being a curve without a name; the names of the catalogue share the rest equally.
  double generic = 0.02;
  /// Odds of one member more, after the first.
  double further_member = 0.5;
  /// Degrees of freedom of the Student's t that sizes follow, of the catalogue's typical size: heavy tails, for a cause may
  /// be much larger than is usual.
  double size_dof = 2.0;
  /// Of what a curve without a name explains [nats]: so much a name of its channel and covariate is worth whose law jumps at a distance
  /// that it chooses. Less may be an edge of an unknown shape.
  double jump_beside_curve = 10.0;
  /// Of what such a name is worth: by so much it is likelier than a smooth curve of its channel and covariate in its place. A law with two
  /// free sizes on one side of a free distance comes near many shapes; a jump that is there leaves a smooth curve far behind.
  double jump_over_curve = 0.075;
  /// Nats that a name beside other names is worth at least, and by which it is likelier than a curve
  /// of another place instead.
  double beside_names = 3.0, over_curve = 1.5;
  /// The same of what the strongest of them is worth: a formula that is a tenth off leaves a hundredth of its own worth to others,
  /// whatever the shape.
  double formula_leaves = 0.01;
  /// Of what a name is worth: by so much a curve of its channel and covariate may be likelier than its formula as it stands, the
  /// allowance for formulas that are off not counted. A tenth leaves a hundredth; beyond that the shape is another one.
  double formula_misses = 0.05;
  /// Probability that the formulas of names are not exact, and by how much of the change that an effect makes its shape is off
  /// then (RMS).
  double formula_is_off = 0.2, formula_error = 0.1;
  /// Corrected p below which residuals are not clean; where readings sit on a grid, which no law describes well.
  double clean_rate = 0.005, clean_rate_on_grid = 1e-5;
  /// Chi-square of the cells' means per degree of freedom, and its p, beyond which nothing is explained.
  double misfit = 1.3, misfit_rate = 0.001;
  /// Of dependence, tails and errors of stops, which have no size in readings: what is left of all that was explained [nats], of
  /// this share or less, does not matter.
  double trace = 0.1;
  /// Rest that does not matter, in standard deviations of one reading (RMS over the readings).
  double tolerance = 0.25;
};

}  // namespace rangecal::diagnosis
