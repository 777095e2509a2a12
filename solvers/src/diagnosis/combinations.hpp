// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <vector>

#include "diagnosis/candidates.hpp"

namespace rangecal::diagnosis {

/// Nats by which two names together must beat the best single free curve: one curve beats two names of a
/// kind. Less where each name has one parameter, its size: two numbers bend no curve. The first `known` of
/// the model's effects are bookkeeping's.
double combination_margin(const Model& model, std::size_t known);
/// Times what the best free curve gains: a name beyond doubt.
inline constexpr double dominant = 1.3;

/// Models of two effects: every one starts from a single effect and adds what its residuals propose.
class Combinations {
 public:
  /// `root`: the seed model with what bookkeeping found, of NLL `seed_nll` [nats] without it, over which
  /// gains are told. `free_curve`: what the best free curve gains. Only those are tried that could be an
  /// answer beside it, or gain `enough`, both in nats over the root, and come within `gap` of the best pair
  /// so far.
  Combinations(const Rows& rows, const Fit& root, double seed_nll, const Rates& rates,
               const RefitOptions& options, double free_curve, double enough, double gap)
      : rows_(rows),
        root_(root),
        rates_(rates),
        options_(options),
        seed_nll_(seed_nll),
        free_curve_(free_curve),
        enough_(enough),
        gap_(gap) {}

  /// Adds a second effect to `first`, of which `battery` is what it leaves.
  void extend(const Candidate& first, const Battery& battery);
  /// The same from effects that were not among the best single ones: those of the best pair, then those of
  /// `proposals`, until a pair is beyond doubt, or to the end if not even that will do. Two causes of one
  /// channel may each look smaller than a third that is neither.
  enum class Until { beyond_doubt, end };
  void extend_from_others(const std::vector<Proposal>& proposals, Until until);
  /// True if the best pair is of two changes of the mean that no curve comes near.
  bool found_beyond_doubt() const;

  /// Best evidence first.
  const std::vector<Candidate>& best_first() const { return pairs_; }

 private:
  /// Starts from both names of the best pair: what else would go with one of them is seen only from there.
  void complete_best();
  /// False if it was started from before.
  bool extend_alone(const Proposal& proposal);
  void keep(Candidate pair);

  const Rows& rows_;
  const Fit& root_;
  const Rates& rates_;
  const RefitOptions& options_;
  double seed_nll_, free_curve_, enough_, gap_;
  std::set<const Effect*> started_;
  std::vector<Candidate> pairs_;
};

}  // namespace rangecal::diagnosis
