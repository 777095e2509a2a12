// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/battery.hpp"
#include "diagnosis/refit.hpp"

namespace rangecal::diagnosis {

/// A catalogued model, fitted exactly.
struct Candidate {
  Fit fit;
  double promised = 0.0;  ///< gain in nats that its projected score promised
  double gain = 0.0;      ///< baseline NLL minus its NLL
  double evidence = 0.0;  ///< gain less the price of what was chosen: what models are ranked by
  /// The same of the gains that scores promised: to be held against a free curve, of which there is only a
  /// score.
  double foreseen = 0.0;
  double log_p = 0.0;  ///< of its question in the battery that proposed it
  int parameters = 0;
  std::optional<double> probability;  ///< over all sets that were compared, where they were
};

/// An effect worth fitting, and where to start.
struct Proposal {
  const Effect* effect = nullptr;
  Eigen::VectorXd start;
  double promised = 0.0, log_p = 0.0, rank = 0.0;
  std::vector<Eigen::VectorXd> others;  ///< further peaks over the start grid, best first
};

/// One nat per parameter that is fitted along (AIC), and ln of the independent places that the others were
/// chosen from: a period among 500 costs more than a time constant among three.
double price_of(const ActiveEffect& active, const Rates& rates);

bool contains(const Model& model, const Effect* effect);

/// The effects of a model by their ids.
std::vector<std::string> ids_of(const Model& model);

/// The catalogue's entries ordered by what their projected scores promise, best grid point of each.
std::vector<Proposal> propose(const Rows& rows, const Battery& battery, const Model& model);

/// A start of a grid, and the nats that its score promises.
using Height = std::pair<double, Eigen::VectorXd>;
/// The local maxima of heights in the order of their grid, highest first.
std::vector<Height> peaks_of(const std::vector<Height>& heights);

/// The most nats that a proposal can be believed to bring.
double credible_gain(const Proposal& proposal);

/// Adds the proposed effect to `base` and refits; `gain` and `evidence` are over `base`. Where the first
/// refit stays far below `wanted` nats of gain, what only polishes it (steps, beats of a period) is left out.
Candidate try_model(const Rows& rows, const Fit& base, const Proposal& proposal, const Rates& rates,
                    const RefitOptions& options, double wanted = 0.0);

/// All that deliver what their scores promised, best evidence first.
std::vector<Candidate> try_all(const Rows& rows, const Fit& base, const std::vector<Proposal>& proposals,
                               const Rates& rates, const RefitOptions& options, double wanted = 0.0);

}  // namespace rangecal::diagnosis
