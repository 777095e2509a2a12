// SPDX-License-Identifier: BSD-3-Clause
#pragma once

#include <set>
#include <vector>

#include "diagnosis/candidates.hpp"

namespace rangecal::diagnosis {

/// Nats by which two names together must beat the best single free curve: one curve beats two names of a
/// kind.
inline constexpr double combination_margin = 5.0;
/// Times what the best free curve gains: a name beyond doubt.
inline constexpr double dominant = 1.3;

/// Models of two effects: every one starts from a single effect and adds what its residuals propose.
class Combinations {
 public:
  /// `root`: the seed model with what bookkeeping found, of NLL `seed_nll` [nats] without it. `free_curve`:
  /// what the best free curve gains. Only those are tried that could reach `sought`, in nats over the seed
  /// model.
  Combinations(const Rows& rows, const Fit& root, double seed_nll, const Rates& rates,
               const RefitOptions& options, double free_curve, double sought)
      : rows_(rows),
        root_(root),
        rates_(rates),
        options_(options),
        seed_nll_(seed_nll),
        free_curve_(free_curve),
        sought_(sought) {}

  /// Adds a second effect to `first`, of which `battery` is what it leaves.
  void extend(const Candidate& first, const Battery& battery);
  /// The same from effects that were not among the best single ones: the second of the best pair, which the
  /// first may have hidden, then those of `proposals`, until a pair is beyond doubt. Two causes of one
  /// channel may each look smaller than a third that is neither.
  void extend_from_others(const std::vector<Proposal>& proposals);

  /// Best evidence first.
  const std::vector<Candidate>& best_first() const { return pairs_; }

 private:
  void extend_alone(const Proposal& proposal);
  void keep(Candidate pair);

  const Rows& rows_;
  const Fit& root_;
  const Rates& rates_;
  const RefitOptions& options_;
  double seed_nll_, free_curve_, sought_;
  std::set<const Effect*> started_;
  std::vector<Candidate> pairs_;
};

}  // namespace rangecal::diagnosis
