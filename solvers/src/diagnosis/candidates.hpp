// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// A set of effects of the catalogue, fitted.
struct Candidate {
  Fit fit;
  double gain = 0.0;      ///< NLL of the baseline less its own [nats]
  double evidence = 0.0;  ///< gain less the price of what was chosen [nats]: what sets are ranked by
  int parameters = 0;
  std::optional<double> probability;  ///< over all sets that were compared, where they were
};

/// An effect worth fitting, and where to start.
struct Proposal {
  const Effect* effect = nullptr;
  Eigen::VectorXd start;
  double predicted_gain = 0.0, rank = 0.0;
  std::vector<Eigen::VectorXd> others;  ///< further peaks over the start grid, best first
};

bool contains(const Model& model, const Effect* effect);

/// The effects of a model by their ids.
std::vector<std::string> ids_of(const Model& model);

/// Of which of the catalogue's entries there may be proposals.
enum class Proposed { all, but_means };

/// The catalogue's entries ordered by the gain that their projected scores predict, best grid point of each.
std::vector<Proposal> propose(const Rows& rows, const Battery& battery, const Model& model,
                              Proposed of = Proposed::all);

/// A start of a grid, and the gain that its score predicts [nats].
using Height = std::pair<double, Eigen::VectorXd>;
/// The local maxima of heights in the order of their grid, highest first.
std::vector<Height> peaks_of(const std::vector<Height>& heights);
/// Those of what a battery says of one effect, at most so many.
std::vector<Height> peaks_of(const Battery& battery, const Effect& effect, std::size_t most);

/// The most nats that a proposal can be believed to bring.
double credible_gain(const Proposal& proposal);

/// Starts a tail of the model from the likeliest point of its grid, and of the noise as the state has it or as half of the
/// readings do; the calibration fitted at each.
void start_tail_where_likeliest(const Rows& rows, std::size_t member, const RefitOptions& options,
                                Model& model, JointState& state);

/// Adds the proposed effect to `base`, fitted from each of its starts; its other optima are looked for around the best.
Fit fit_proposal(const Rows& rows, const Fit& base, const Proposal& proposal, const RefitOptions& options);

}  // namespace rangecal::diagnosis
